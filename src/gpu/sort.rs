//! Sorting on the GPU (`wgsl/sort.wgsl`).

use bytemuck::{Pod, Zeroable};
use wgpu::{Buffer, BufferUsages, ComputePass, ComputePipeline, Device, PipelineCache};

use super::listing::Listing;
use super::{
    Kernel,
    binding::{Group, Layout, whole},
    dispatch,
    scan::{Scan, ScanBuffer},
    shader, storage,
    uniforms::Parameters,
};
use crate::error::Error;

/// Keys that one workgroup moves, and values that a digit has; as in the shader.
const BLOCK: u32 = 1024;
const DIGITS: u32 = 16;
const DIGIT_BITS: u32 = 4;

/// Bytes of a pair of key and value, an `Item`.
const ITEM_BYTES: u64 = 8;

crate::reflection::bytes_of_wgsl!(
    items_are_the_shaders: ITEM_BYTES, as "Item" in ["sort"]
);

const SOURCE: &str = include_str!("../../wgsl/sort.wgsl");

const LABEL: &str = "deep-screen-space sort";

/// The pipelines.
#[derive(Debug)]
pub(crate) struct Sort {
    layout: Layout,
    count_digits: ComputePipeline,
    move_keys: ComputePipeline,
    scan: Scan,
}

/// An array of pairs of key and value, each a `u32`, that is sorted by key.
#[derive(Debug)]
pub(crate) struct SortBuffer {
    /// The pairs, before and after: an even number of passes brings them back here.
    pub items: Buffer,
    other: Buffer,
    counts: ScanBuffer,
    passes: Vec<Group>,
    blocks: u32,
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct SortParams {
    pub(crate) shift: u32,
    pub(crate) blocks: u32,
    pub(crate) padding: [u32; 2],
}

crate::reflection::same_as_wgsl!(
    params_are_the_shaders: SortParams as "Params" in ["sort"]
    { shift, blocks }
);

impl Sort {
    pub fn new(device: &Device, cache: Option<&PipelineCache>) -> Result<Self, Error> {
        let module = shader::create(device, LABEL, shader::assemble("sort", SOURCE, &[], &[])?);
        let layout = module.layout(device, &["count_digits", "move_keys"]);
        let kernel = |entry| {
            Kernel {
                label: LABEL,
                module: &module,
                entry,
                layouts: &[&layout.raw],
                constants: &[],
                cache,
            }
            .create(device)
        };
        Ok(Self {
            count_digits: kernel("count_digits"),
            move_keys: kernel("move_keys"),
            scan: Scan::new(device, cache)?,
            layout,
        })
    }

    /// Room for `capacity` pairs, of which the first `u32` of `length` says how many there are.
    pub fn buffer(
        &self,
        device: &Device,
        label: &'static str,
        capacity: u32,
        length: &Buffer,
    ) -> Result<SortBuffer, Error> {
        let blocks = capacity.div_ceil(BLOCK).max(1);
        let bytes = ITEM_BYTES * u64::from(capacity);
        let items = storage(device, label, bytes, BufferUsages::empty())?;
        let other = storage(device, label, bytes, BufferUsages::empty())?;
        let counts = self.scan.buffer(device, label, DIGITS * blocks)?;
        let mut parameters = Parameters::new(device);
        let places: Vec<_> = (0..32 / DIGIT_BITS)
            .map(|pass| {
                parameters.add(&SortParams {
                    shift: pass * DIGIT_BITS,
                    blocks,
                    padding: [0; 2],
                })
            })
            .collect();
        let parameters = parameters.fixed(device, label);
        let passes = (0..)
            .zip(places)
            .map(|(pass, place)| {
                let (from, to) = if pass % 2 == 0 {
                    (&items, &other)
                } else {
                    (&other, &items)
                };
                let resources = [
                    ("params", parameters.at(place)),
                    ("length", whole(length)),
                    ("unsorted", whole(from)),
                    ("sorted", whole(to)),
                    ("counts", whole(&counts.values)),
                ];
                self.layout.group(device, &resources)
            })
            .collect();
        Ok(SortBuffer {
            items,
            other,
            counts,
            passes,
            blocks,
        })
    }

    pub fn record(&self, pass: &mut ComputePass<'_>, buffer: &SortBuffer) {
        for group in &buffer.passes {
            dispatch(pass, &self.count_digits, group, buffer.blocks);
            self.scan.record(pass, &buffer.counts);
            dispatch(pass, &self.move_keys, group, buffer.blocks);
        }
    }
}

impl SortBuffer {
    pub fn bytes(&self) -> u64 {
        self.items.size() + self.other.size() + self.counts.bytes()
    }
}

/// Every module of the pass.
pub(crate) fn list<E>(all: &mut Listing<'_, E>) -> Result<(), Error> {
    all.add("sort", shader::assemble("sort", SOURCE, &[], &[])?);
    Ok(())
}

#[cfg(test)]
pub(super) mod tests {
    use wgpu::util::DeviceExt;

    use super::*;

    pub fn device() -> (Device, wgpu::Queue) {
        pollster::block_on(async {
            let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle_from_env();
            descriptor.flags |= wgpu::InstanceFlags::DISCARD_HAL_LABELS;
            let adapter = wgpu::Instance::new(descriptor)
                .request_adapter(&wgpu::RequestAdapterOptions::default())
                .await
                .expect("a graphics adapter");
            adapter
                .request_device(&wgpu::DeviceDescriptor::default())
                .await
                .expect("a device")
        })
    }

    fn sort(
        (device, queue): &(Device, wgpu::Queue),
        sort: &Sort,
        keys: &[u32],
        capacity: u32,
    ) -> Vec<[u32; 2]> {
        let length = device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: None,
            contents: bytemuck::bytes_of(&(keys.len() as u32)),
            usage: BufferUsages::STORAGE,
        });
        // What lies beyond the length is not to be touched.
        let items: Vec<[u32; 2]> = (0..capacity)
            .map(|i| [keys.get(i as usize).copied().unwrap_or(7), i])
            .collect();
        let input = device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: None,
            contents: bytemuck::cast_slice(&items),
            usage: BufferUsages::COPY_SRC | BufferUsages::STORAGE,
        });
        let buffer = sort
            .buffer(device, "sorted", capacity, &length)
            .expect("room");
        let output = device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: 8 * u64::from(capacity),
            usage: BufferUsages::MAP_READ | BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        // The sort's own buffers are the GPU's alone: kernels copy into and out of them.
        let source = "
            @group(0) @binding(0) var<storage, read> a: array<vec2u>;
            @group(0) @binding(1) var<storage, read_write> b: array<vec2u>;
            @compute @workgroup_size(64)
            fn copy(@builtin(global_invocation_id) id: vec3u) {
              if id.x < arrayLength(&a) { b[id.x] = a[id.x]; }
            }";
        let module = shader::create(device, "copy", source.into());
        let (layout, copy) = module.kernel(device, "copy", &[], None);
        let sorted = storage(
            device,
            "sorted",
            8 * u64::from(capacity),
            BufferUsages::COPY_SRC,
        )
        .expect("room");
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        let groups = capacity.div_ceil(64);
        let group = |from, to| layout.group(device, &[("a", whole(from)), ("b", whole(to))]);
        dispatch(&mut pass, &copy, &group(&input, &buffer.items), groups);
        sort.record(&mut pass, &buffer);
        dispatch(&mut pass, &copy, &group(&buffer.items, &sorted), groups);
        drop(pass);
        encoder.copy_buffer_to_buffer(&sorted, 0, &output, 0, output.size());
        queue.submit([encoder.finish()]);
        output.map_async(wgpu::MapMode::Read, .., |mapped| mapped.expect("it maps"));
        device
            .poll(wgpu::PollType::wait_indefinitely())
            .expect("the device answers");
        let bytes = output.get_mapped_range(..).expect("it is mapped");
        bytemuck::pod_collect_to_vec(&bytes)
    }

    /// By key, and of equal keys the one that came first; whatever the number of keys is to a block.
    #[test]
    fn sorts_and_is_stable() {
        let device = device();
        let kernels = Sort::new(&device.0, None).expect("pipelines");
        let random = |i: u32| {
            let x = (i + 1).wrapping_mul(0x9e37_79b9);
            (x ^ (x >> 15)).wrapping_mul(0x846c_a68b) ^ (x >> 7)
        };
        for (name, key) in [
            ("random", random as fn(u32) -> u32),
            ("equal", |_| 0xf000_0001),
            ("sorted", |i| i * 40_000),
            ("reversed", |i| u32::MAX - i),
            ("few", |i| (i.wrapping_mul(7) % 5) << 28),
        ] {
            for (length, capacity) in [
                (0, 1),
                (0, 3000),
                (1, 1),
                (1, 1025),
                (1023, 1023),
                (1024, 1024),
                (1025, 1025),
                (1500, 4096),
                (100_000, 100_000),
            ] {
                let keys: Vec<u32> = (0..length).map(key).collect();
                let mut expected: Vec<[u32; 2]> =
                    keys.iter().zip(0..).map(|(&key, i)| [key, i]).collect();
                expected.sort_by_key(|item| item[0]);
                let found = sort(&device, &kernels, &keys, capacity);
                let wrong = found.iter().zip(&expected).position(|(f, e)| f != e);
                assert_eq!(wrong, None, "{name}, {length} keys in {capacity}");
                let beyond = found.iter().zip(0..).skip(length as usize);
                for (item, i) in beyond {
                    assert_eq!(*item, [7, i], "{name}, {length} keys in {capacity}");
                }
            }
        }
    }
}
