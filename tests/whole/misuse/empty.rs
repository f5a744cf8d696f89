//! No room at all, and more than a device has.

use deep_screen_space::{
    MultiResMask, ObscuranceSampling, ObscuranceVolume, SurfelShader, SurfelShaderInput,
    SurfelShaderSettings, VolumetricObscurance, VolumetricObscuranceDescriptor,
};

use super::*;
use support::testing::refusals::refused;

/// Nothing shines and nothing occludes, and nothing fails.
#[test]
fn clouds_without_room_work_in_every_pass() {
    let lab = &*LAB;
    let device = &lab.gpu.device;
    let mut encoder = lab.gpu.encoder();
    let e = &mut encoder;
    for (surfels, pieces) in [(0, 1), (0, 1 << 10), (1, 1)] {
        let cloud = lab.recorded(
            e,
            CloudCapacity {
                surfels,
                pieces,
                triangles: 1,
            },
        );
        let mut clusters = lab.clusters(&cloud);
        lab.record_clusters(e, &cloud, &mut clusters)
            .expect("clusters");
        lab.splat(e, (&cloud, &clusters), &lab.splat_view())
            .expect("sums");
        let bounds = lab.bvh(&cloud);
        lab.record_bvh(e, &cloud, &bounds).expect("a hierarchy");
        for pass in [&lab.bounced, &lab.lit] {
            let hits = lab.hits(pass);
            lab.trace(e, pass, (&cloud, &bounds), &lab.materials, &hits)
                .expect("hits");
        }
        let shader = SurfelShader::new(device).expect("pipelines");
        let radiance = shader.create_radiance(device, &cloud).expect("room");
        let input = SurfelShaderInput {
            cloud: &cloud,
            materials: &lab.materials,
            lights: &[],
            radiance: &radiance,
            timestamps: None,
        };
        let settings = SurfelShaderSettings::default();
        shader.record(device, e, &input, &settings).expect("light");
    }
    submit(lab, encoder);
}

/// Their products are beyond 64 bits: overflow is a panic where it is checked.
#[test]
fn sizes_beyond_all_bounds_are_refused() {
    let lab = &*LAB;
    let device = &lab.gpu.device;
    let (width, height) = (1 << 31, 1 << 30);
    let (kind, limit) = ("Limit", "max_texture_dimension_2d");
    let needed = "2147483648";
    for pass in [&lab.bounced, &lab.lit] {
        refused(
            pass.create_view(device, width, height, 64),
            kind,
            limit,
            needed,
        );
    }
    refused(
        lab.splatter.create_view(device, width, height, 8),
        kind,
        limit,
        needed,
    );
    let masks = MultiResMask::new(device).expect("pipelines");
    refused(
        masks.create_view(device, width, height, true),
        kind,
        limit,
        needed,
    );
    let descriptor = VolumetricObscuranceDescriptor {
        sampling: ObscuranceSampling::OneArea,
        volume: ObscuranceVolume::Sphere,
    };
    let pass = VolumetricObscurance::new(device, &descriptor).expect("pipelines");
    refused(
        pass.create_moments(device, width, height),
        kind,
        limit,
        needed,
    );
    refused(
        pass.create_moments(device, u32::MAX, u32::MAX),
        kind,
        limit,
        "4294967295",
    );
}

/// A device says how much it can hold, and that much there is.
#[test]
fn the_largest_cloud_is_told() {
    let limits = wgpu::Limits::default();
    let largest = CloudCapacity::largest(&limits);
    assert_eq!(
        (largest.surfels, largest.pieces, largest.triangles),
        (1 << 23, 2_796_202, (1 << 25) - 1)
    );
    let lab = &*LAB;
    let limits = lab.gpu.device.limits();
    let mut more = CloudCapacity::largest(&limits);
    if more.pieces < 1 << 23 {
        more.pieces += 1;
        let made = lab.surfelizer.create_cloud(
            &lab.gpu.device,
            CloudCapacity {
                surfels: 0,
                triangles: 0,
                ..more
            },
        );
        let limit = limits.max_storage_buffer_binding_size.to_string();
        refused(made, "Limit", "max_storage_buffer_binding_size", &limit);
    }
}
