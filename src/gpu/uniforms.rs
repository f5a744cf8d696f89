//! Uniforms of recordings.
//!
//! A pass has one buffer that its kernels read their parameters from. A recording brings new ones in a page that the CPU has
//! written, and first of all copies them there: the copy stands in the encoder before what reads it, and the copies of other
//! recordings before theirs, so that recordings never overwrite each other's parameters, whether they share an encoder or
//! not, in whatever order encoders are submitted. As the buffer stays the same, so do bind groups.
//!
//! A page is mapped again once the encoder that copies from it was submitted and has run, and then serves another recording.
//! One whose encoder is dropped goes with it. Nothing is submitted, polled or waited for here: wgpu maps when the caller
//! submits.

use std::{
    num::NonZeroU64,
    sync::{Arc, Mutex, PoisonError},
};

use bytemuck::Pod;
use wgpu::{
    BindingResource, Buffer, BufferBinding, BufferUsages, CommandEncoder, Device, MapMode,
    util::DeviceExt,
};

use super::binding::Resource;
use crate::made;

/// The least that pages and buffers are made with, bytes.
const LEAST: u64 = 1024;

/// Where a pass's parameters are.
#[derive(Debug)]
pub(crate) struct Uniforms {
    label: &'static str,
    /// What kernels read; a longer one takes its place where a recording needs it.
    buffer: Mutex<Option<Buffer>>,
    /// Mapped, and of no use to any encoder.
    pages: Arc<Mutex<Vec<Buffer>>>,
}

/// Parameters of a recording, one after the other.
#[derive(Debug)]
pub(crate) struct Parameters {
    bytes: Vec<u8>,
    /// Of offsets.
    alignment: usize,
}

/// Where one of them is.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Place {
    offset: u32,
    size: u64,
}

/// Parameters in a buffer.
#[derive(Debug)]
pub(crate) struct Uploaded(Buffer);

impl Parameters {
    pub fn new(device: &Device) -> Self {
        Self {
            bytes: Vec::new(),
            alignment: device.limits().min_uniform_buffer_offset_alignment as usize,
        }
    }

    /// One more.
    pub fn add<T: Pod>(&mut self, value: &T) -> Place {
        let offset = self.bytes.len().next_multiple_of(self.alignment);
        self.bytes.resize(offset, 0);
        self.bytes.extend_from_slice(bytemuck::bytes_of(value));
        Place {
            offset: offset as u32,
            size: size_of::<T>() as u64,
        }
    }

    /// In a buffer that is never written again, for what stays as long as an object does.
    pub fn fixed(self, device: &Device, label: &str) -> Uploaded {
        made::count(made::Kind::Buffer);
        Uploaded(
            device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
                label: Some(label),
                contents: &self.bytes,
                usage: BufferUsages::UNIFORM,
            }),
        )
    }
}

impl Uploaded {
    /// One of them as a binding.
    pub fn at(&self, place: Place) -> Resource<'_> {
        Resource {
            raw: BindingResource::Buffer(BufferBinding {
                buffer: &self.0,
                offset: 0,
                size: NonZeroU64::new(place.size),
            }),
            offset: Some(place.offset),
        }
    }
}

impl Uniforms {
    pub fn new(label: &'static str) -> Self {
        Self {
            label,
            buffer: Mutex::new(None),
            pages: Arc::default(),
        }
    }

    /// Records a copy of a recording's parameters, all of them: the next copy takes their places.
    pub fn upload(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        parameters: &Parameters,
    ) -> Uploaded {
        let bytes = &parameters.bytes[..];
        let length = bytes.len().next_multiple_of(4) as u64;
        let buffer = self.buffer(device, length);
        if length == 0 {
            return Uploaded(buffer);
        }
        let page = self.page(device, length);
        // A device that is lost maps nothing, and runs nothing either.
        if let Ok(mut mapped) = page.get_mapped_range_mut(..length) {
            mapped.slice(..bytes.len()).copy_from_slice(bytes);
        }
        page.unmap();
        encoder.copy_buffer_to_buffer(&page, 0, &buffer, 0, Some(length));
        let (pages, again) = (Arc::clone(&self.pages), page.clone());
        encoder.map_buffer_on_submit(&page, MapMode::Write, .., move |mapped| {
            if mapped.is_ok() {
                let mut pages = pages.lock().unwrap_or_else(PoisonError::into_inner);
                pages.push(again);
            }
        });
        Uploaded(buffer)
    }

    /// The same for a recording that has one.
    pub fn upload_one<T: Pod>(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        value: &T,
    ) -> (Uploaded, Place) {
        let mut parameters = Parameters::new(device);
        let place = parameters.add(value);
        (self.upload(device, encoder, &parameters), place)
    }

    fn buffer(&self, device: &Device, length: u64) -> Buffer {
        let mut buffer = self.buffer.lock().unwrap_or_else(PoisonError::into_inner);
        match &*buffer {
            Some(buffer) if buffer.size() >= length => buffer.clone(),
            _ => {
                let usage = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
                buffer
                    .insert(self.create(device, length, usage, false))
                    .clone()
            }
        }
    }

    /// One that is mapped and long enough. Shorter ones are of no more use.
    fn page(&self, device: &Device, length: u64) -> Buffer {
        let mut pages = self.pages.lock().unwrap_or_else(PoisonError::into_inner);
        while let Some(page) = pages.pop() {
            if page.size() >= length {
                return page;
            }
        }
        drop(pages);
        let usage = BufferUsages::MAP_WRITE | BufferUsages::COPY_SRC;
        self.create(device, length, usage, true)
    }

    fn create(
        &self,
        device: &Device,
        length: u64,
        usage: BufferUsages,
        mapped_at_creation: bool,
    ) -> Buffer {
        made::count(made::Kind::Buffer);
        device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(self.label),
            size: length.next_power_of_two().max(LEAST),
            usage,
            mapped_at_creation,
        })
    }
}

#[cfg(test)]
mod tests {
    use wgpu::{BufferUsages, CommandEncoder, ComputePipeline, Device, Queue};

    use super::*;
    use crate::gpu::{
        binding::{Kept, Layout, whole},
        shader,
        sort::tests::device,
        storage,
    };

    /// A kernel that writes its parameters to where they say.
    struct Pass {
        layout: Layout,
        pipeline: ComputePipeline,
        uniforms: Uniforms,
        written: Buffer,
        kept: Kept,
    }

    impl Pass {
        fn new(device: &Device) -> Self {
            let source = "
                struct Params { value: u32, at: u32, padding: vec2u }
                @group(0) @binding(3) var<uniform> params: Params;
                @group(0) @binding(1) var<storage, read_write> written: array<u32>;
                @compute @workgroup_size(1)
                fn write() { written[params.at] = params.value; }";
            let module = shader::create(device, "uniforms", source.into());
            let (layout, pipeline) = module.kernel(device, "write", &[], None);
            let written = storage(device, "written", 4 * 4096, BufferUsages::COPY_SRC);
            Self {
                layout,
                pipeline,
                uniforms: Uniforms::new("uniforms"),
                written: written.expect("room"),
                kept: Kept::default(),
            }
        }

        /// Writes `value`, `value + 1` … from `at` on, a dispatch each.
        fn record(
            &self,
            device: &Device,
            encoder: &mut CommandEncoder,
            value: u32,
            at: u32,
            n: u32,
        ) {
            let mut parameters = Parameters::new(device);
            let places: Vec<_> = (0..n)
                .map(|i| parameters.add(&[value + i, at + i, 0, 0]))
                .collect();
            let parameters = self.uniforms.upload(device, encoder, &parameters);
            let mut groups = self.kept.groups(device);
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            pass.set_pipeline(&self.pipeline);
            for place in places {
                let resources = [
                    ("written", whole(&self.written)),
                    ("params", parameters.at(place)),
                ];
                let group = groups.next(&self.layout, &resources);
                pass.set_bind_group(0, &group.raw, &group.offsets);
                pass.dispatch_workgroups(1, 1, 1);
            }
        }

        fn read(&self, device: &Device, queue: &Queue) -> Vec<u32> {
            let read = device.create_buffer(&wgpu::BufferDescriptor {
                label: None,
                size: self.written.size(),
                usage: BufferUsages::MAP_READ | BufferUsages::COPY_DST,
                mapped_at_creation: false,
            });
            let mut encoder =
                device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            encoder.copy_buffer_to_buffer(&self.written, 0, &read, 0, None);
            queue.submit([encoder.finish()]);
            read.map_async(MapMode::Read, .., |mapped| mapped.expect("it maps"));
            wait(device);
            let bytes = read.get_mapped_range(..).expect("it is mapped");
            bytemuck::pod_collect_to_vec(&bytes)
        }

        fn pages(&self) -> usize {
            self.uniforms.pages.lock().expect("no panics").len()
        }
    }

    fn wait(device: &Device) {
        device
            .poll(wgpu::PollType::wait_indefinitely())
            .expect("the device answers");
    }

    fn encoder(device: &Device) -> CommandEncoder {
        device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default())
    }

    /// In one encoder, and in several that are submitted in another order or never.
    #[test]
    fn recordings_keep_their_parameters() {
        let (device, queue) = &device();
        let pass = Pass::new(device);
        let mut first = encoder(device);
        pass.record(device, &mut first, 100, 0, 3);
        // More than there is room for so far.
        pass.record(device, &mut first, 200, 3, 40);
        let mut second = encoder(device);
        pass.record(device, &mut second, 300, 43, 2);
        let mut dropped = encoder(device);
        pass.record(device, &mut dropped, 400, 0, 50);
        let finished = encoder(device);
        let mut third = encoder(device);
        pass.record(device, &mut third, 500, 45, 1);
        drop(dropped);
        drop(finished.finish());
        queue.submit([third.finish(), second.finish()]);
        queue.submit([first.finish()]);
        let expected: Vec<u32> = (100..103)
            .chain(200..240)
            .chain(300..302)
            .chain(500..501)
            .collect();
        assert_eq!(pass.read(device, queue)[..46], expected);
    }

    /// A page serves one recording after the other, and no more are made than are under way.
    #[test]
    fn pages_come_back() {
        let (device, queue) = &device();
        let pass = Pass::new(device);
        for frame in 0..20 {
            let mut encoders = [encoder(device), encoder(device)];
            for (i, encoder) in (0..).zip(&mut encoders) {
                pass.record(device, encoder, 1000 * i + frame, 20 * i + frame, 1);
            }
            assert_eq!(pass.pages(), 0, "frame {frame}");
            queue.submit(encoders.map(CommandEncoder::finish));
            wait(device);
            assert_eq!(pass.pages(), 2, "frame {frame}");
        }
        let expected: Vec<u32> = (0..20).chain(1000..1020).collect();
        assert_eq!(pass.read(device, queue)[..40], expected);
        // An encoder that is never submitted takes its page along.
        let mut dropped = encoder(device);
        pass.record(device, &mut dropped, 0, 0, 1);
        drop(dropped.finish());
        wait(device);
        assert_eq!(pass.pages(), 1);
    }
}
