//! Buffers of any size: whole words of them are bound, and no more than is needed.

use deep_screen_space::{
    Gatherer, ObscuranceInput, ObscuranceSampling, ObscuranceSettings, ObscuranceVolume, PixelList,
    PolygonLight, SurfelShader, SurfelShaderInput, SurfelShaderSettings, Timestamps,
    VolumetricObscurance, VolumetricObscuranceDescriptor,
};

use super::*;
use support::testing::refusals::refused;

impl Lab {
    fn bytes(&self, size: u64, usage: BufferUsages) -> wgpu::Buffer {
        self.gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size,
            usage,
            mapped_at_creation: false,
        })
    }
}

#[test]
fn buffers_of_any_size_are_bound() {
    let lab = &*LAB;
    let device = &lab.gpu.device;
    let storage = BufferUsages::STORAGE;
    let mut encoder = lab.gpu.encoder();
    let e = &mut encoder;
    let cloud = lab.recorded(e, ROOM);
    let bounds = lab.bvh(&cloud);
    lab.record_bvh(e, &cloud, &bounds).expect("a hierarchy");
    let hits = lab.hits(&lab.lit);
    let shader = SurfelShader::new(device).expect("pipelines");
    let room = 32 * u64::from(ROOM.surfels);
    // One longer than a binding may be, where the device has any such.
    let limits = device.limits();
    let long = limits.max_storage_buffer_binding_size + 5;
    let long = (long <= limits.max_buffer_size).then_some(long);
    let shade = |e: &mut wgpu::CommandEncoder, materials: u64, radiance: u64| {
        let input = SurfelShaderInput {
            cloud: &cloud,
            materials: &lab.bytes(materials, storage),
            lights: &[],
            radiance: &lab.bytes(radiance, storage),
            timestamps: None,
        };
        shader.record(device, e, &input, &SurfelShaderSettings::default())
    };
    for more in [0, 1, 2, 3, 31] {
        shade(e, 32 + more, room + more).expect("light");
        let materials = lab.bytes(32 + more, storage);
        lab.trace(e, &lab.lit, (&cloud, &bounds), &materials, &hits)
            .expect("hits");
        let polygons = Gatherer::polygons(device);
        let lights = lab.bytes(size_of::<PolygonLight>() as u64 + more, storage);
        polygons.bind_polygons(device, &lights).expect("lights");
    }
    refused(shade(e, 31, room), "Buffer", "materials", "at least 32");
    refused(shade(e, 32, room - 1), "Buffer", "radiance", "at least");

    let descriptor = VolumetricObscuranceDescriptor {
        sampling: ObscuranceSampling::Lines(deep_screen_space::DiskSamples::Nine),
        volume: ObscuranceVolume::Sphere,
    };
    let pass = VolumetricObscurance::new(device, &descriptor).expect("pipelines");
    let target = lab.gpu.storage(Format::R32Float, SIDE, SIDE);
    let list = |e: &mut wgpu::CommandEncoder, bytes| {
        let input = ObscuranceInput {
            depth: lab.depth.texture().into(),
            normals: None,
            camera: &lab.camera,
            moments: None,
            work: Some(PixelList {
                level: 0,
                pixels: &lab.bytes(bytes, storage),
                dispatch: &lab.bytes(13, BufferUsages::INDIRECT),
            }),
            target: target.texture().into(),
            timestamps: None,
        };
        pass.record(device, e, &input, &ObscuranceSettings::default())
    };
    let listed = 4 * (1 + u64::from(SIDE * SIDE));
    for bytes in [listed, listed + 1, listed + 3] {
        list(e, bytes).expect("a list");
    }
    refused(
        list(e, listed - 1),
        "Buffer",
        "PixelList::pixels",
        "at least",
    );
    if let Some(long) = long {
        // What is needed of it fits.
        shade(e, 32, long).expect("light");
        list(e, long).expect("a list");
        let limit = "max_storage_buffer_binding_size";
        refused(shade(e, long + 64, room), "Limit", limit, "materials");
    }
    submit(lab, encoder);
}

#[test]
fn timestamps_lie_in_their_set() {
    let lab = &*LAB;
    let device = &lab.gpu.device;
    let mut encoder = lab.gpu.encoder();
    let cloud = lab.recorded(&mut encoder, ROOM);
    let bounds = lab.bvh(&cloud);
    let mut record = |ty, begin, end| {
        let set = device.create_query_set(&wgpu::QuerySetDescriptor {
            label: None,
            ty,
            count: 2,
        });
        let timestamps = Some(Timestamps {
            set: &set,
            begin,
            end,
        });
        lab.builder
            .record(device, &mut encoder, &cloud, &bounds, timestamps)
    };
    let occlusion = wgpu::QueryType::Occlusion;
    refused(
        record(occlusion, 0, 1),
        "Mismatch",
        "Timestamps::set",
        "Timestamp",
    );
    if device.features().contains(wgpu::Features::TIMESTAMP_QUERY) {
        let times = wgpu::QueryType::Timestamp;
        record(times, 0, 1).expect("times");
        refused(
            record(times, 2, 0),
            "Setting",
            "Timestamps::begin",
            "below its count",
        );
        refused(
            record(times, 0, 2),
            "Setting",
            "Timestamps::end",
            "below its count",
        );
    }
    submit(lab, encoder);
}
