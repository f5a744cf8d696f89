//! A device for examples, tests and benches, and the blocking reads that a library must not do.
//!
//! In a browser nothing may block: there [`Gpu::open_soon`] and [`Gpu::read_texture_soon`] serve, and what ends with a wait does
//! not wait.

use std::{
    future::poll_fn,
    sync::{Arc, Mutex},
    task::{Poll, Waker},
};

#[cfg(feature = "native")]
use crate::stopwatch::Stopwatch;
use deep_screen_space::wgpu::{self, util::DeviceExt};

/// What a device is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ask {
    /// `Limits::default()` and no features: the portable floor.
    Floor,
    /// The floor and those features that passes make use of where they are.
    Useful,
    /// The floor, but for buffers as large as the adapter offers: for scenes of any size.
    Room,
    /// Both.
    UsefulRoom,
    /// Everything that the adapter offers.
    All,
}

impl Ask {
    /// `DSS_LIMITS`: `default` or unset for the floor, `all` for everything.
    pub fn from_env() -> Self {
        Self::from_env_or(Self::Floor).unwrap_or_else(|problem| panic!("{problem}"))
    }

    /// The same, with room where it is unset.
    pub fn room_from_env() -> Result<Self, String> {
        Self::from_env_or(Self::Room)
    }

    fn from_env_or(unset: Self) -> Result<Self, String> {
        match std::env::var_os("DSS_LIMITS") {
            None => Ok(unset),
            Some(text) if text == "all" => Ok(Self::All),
            Some(text) if text == "default" => Ok(Self::Floor),
            Some(other) => Err(format!(
                "DSS_LIMITS is {}, accepted is default or all",
                other.display()
            )),
        }
    }
}

impl Ask {
    fn of(self, adapter: &wgpu::Adapter) -> (wgpu::Features, wgpu::Limits) {
        let floor = wgpu::Limits::default();
        match self {
            Self::Floor => (wgpu::Features::empty(), floor),
            Self::Useful => (
                adapter.features() & (wgpu::Features::SUBGROUP | wgpu::Features::TIMESTAMP_QUERY),
                floor,
            ),
            Self::UsefulRoom => (Self::Useful.of(adapter).0, Self::Room.of(adapter).1),
            Self::Room => {
                let offered = adapter.limits();
                let limits = wgpu::Limits {
                    max_buffer_size: offered.max_buffer_size.max(floor.max_buffer_size),
                    max_storage_buffer_binding_size: offered
                        .max_storage_buffer_binding_size
                        .max(floor.max_storage_buffer_binding_size),
                    ..floor
                };
                (wgpu::Features::empty(), limits)
            }
            // Experimental features need an unsafe token.
            Self::All => (
                adapter.features() & !wgpu::Features::all_experimental_mask(),
                adapter.limits(),
            ),
        }
    }
}

/// A device with its queue.
pub struct Gpu {
    /// For what is drawn to a window's or a page's surface.
    pub instance: wgpu::Instance,
    pub device: wgpu::Device,
    pub queue: wgpu::Queue,
    pub adapter: wgpu::AdapterInfo,
}

impl Gpu {
    /// Opens the first adapter that wgpu prefers; one line says why there is none.
    #[cfg(feature = "native")]
    pub fn open(ask: Ask) -> Result<Self, String> {
        pollster::block_on(Self::open_soon(ask))
    }

    /// The same without blocking.
    pub async fn open_soon(ask: Ask) -> Result<Self, String> {
        Self::open_as(|adapter| {
            let (features, limits) = ask.of(adapter);
            Ok((features, limits, wgpu::ExperimentalFeatures::disabled()))
        })
        .await
    }

    /// One for rays that the device traces itself, given the token that says so: with limits, or with the floor and all that the
    /// adapter offers for such rays. One line says where it offers none.
    #[cfg(feature = "native")]
    pub fn open_for_ray_queries(
        token: wgpu::ExperimentalFeatures,
        limits: Option<wgpu::Limits>,
    ) -> Result<Self, String> {
        pollster::block_on(Self::open_as(|adapter| {
            let feature = wgpu::Features::EXPERIMENTAL_RAY_QUERY;
            if !adapter.features().contains(feature) {
                return Err(format!("{} offers no ray queries", adapter.get_info().name));
            }
            let limits = limits.unwrap_or_else(|| {
                wgpu::Limits::default().using_acceleration_structure_values(adapter.limits())
            });
            let times = adapter.features() & wgpu::Features::TIMESTAMP_QUERY;
            Ok((feature | times, limits, token))
        }))
    }

    /// One that can present to a surface of this instance's: see [`Gpu::instance`]. The adapter comes too, which knows the
    /// surface's formats.
    #[cfg(feature = "native")]
    pub fn open_for(
        instance: &wgpu::Instance,
        surface: &wgpu::Surface<'_>,
        ask: Ask,
    ) -> Result<(Self, wgpu::Adapter), String> {
        pollster::block_on(Self::open_of(instance, Some(surface), |adapter| {
            let (features, limits) = ask.of(adapter);
            Ok((features, limits, wgpu::ExperimentalFeatures::disabled()))
        }))
    }

    /// What adapters are asked of, by the environment's wishes.
    pub fn instance(mut descriptor: wgpu::InstanceDescriptor) -> wgpu::Instance {
        // lavapipe of Mesa 22.3 (Debian 12) crashes on debug labels inside command buffers.
        descriptor.flags |= wgpu::InstanceFlags::DISCARD_HAL_LABELS;
        wgpu::Instance::new(descriptor)
    }

    async fn open_as(
        ask: impl FnOnce(
            &wgpu::Adapter,
        )
            -> Result<(wgpu::Features, wgpu::Limits, wgpu::ExperimentalFeatures), String>,
    ) -> Result<Self, String> {
        let descriptor = wgpu::InstanceDescriptor::new_without_display_handle_from_env();
        let (gpu, _) = Self::open_of(&Self::instance(descriptor), None, ask).await?;
        Ok(gpu)
    }

    async fn open_of(
        instance: &wgpu::Instance,
        compatible_surface: Option<&wgpu::Surface<'_>>,
        ask: impl FnOnce(
            &wgpu::Adapter,
        )
            -> Result<(wgpu::Features, wgpu::Limits, wgpu::ExperimentalFeatures), String>,
    ) -> Result<(Self, wgpu::Adapter), String> {
        let adapter = instance
            .request_adapter(&wgpu::RequestAdapterOptions {
                power_preference: wgpu::PowerPreference::HighPerformance,
                compatible_surface,
                ..Default::default()
            })
            .await
            .map_err(|e| {
                format!(
                    "no graphics adapter: {e} (scripts/demo.sh installs a software Vulkan driver)"
                )
            })?;
        let (required_features, required_limits, experimental_features) = ask(&adapter)?;
        let (device, queue) = adapter
            .request_device(&wgpu::DeviceDescriptor {
                label: Some("deep-screen-space"),
                required_features,
                required_limits,
                experimental_features,
                ..Default::default()
            })
            .await
            .map_err(|e| format!("no device: {e}"))?;
        let gpu = Self {
            instance: instance.clone(),
            device,
            queue,
            adapter: adapter.get_info(),
        };
        Ok((gpu, adapter))
    }

    /// From now on a program ends with one line where the device refuses or runs out of something that nothing foresaw,
    /// such as memory.
    pub fn end_on_error(&self, program: &'static str) {
        self.device
            .on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
                let text = error.to_string();
                let lines: Vec<&str> = text.split_whitespace().collect();
                eprintln!("{program}: the device: {}", lines.join(" "));
                std::process::exit(1);
            }));
    }

    /// Adapter and driver in a line.
    pub fn name(&self) -> String {
        format!("{} ({:?})", self.adapter.name, self.adapter.backend)
    }

    /// A buffer with contents.
    pub fn buffer<T: bytemuck::Pod>(
        &self,
        contents: &[T],
        usage: wgpu::BufferUsages,
    ) -> wgpu::Buffer {
        // Zero-sized buffers cannot be bound.
        let bytes: &[u8] = bytemuck::cast_slice(contents);
        let padded;
        let bytes = if bytes.is_empty() {
            &[0; 16]
        } else if !bytes.len().is_multiple_of(4) {
            padded = [bytes, &[0; 3]].concat();
            &padded[..bytes.len().next_multiple_of(4)]
        } else {
            bytes
        };
        self.device
            .create_buffer_init(&wgpu::util::BufferInitDescriptor {
                label: None,
                contents: bytes,
                usage,
            })
    }

    /// Submits and waits.
    pub fn finish(&self, encoder: wgpu::CommandEncoder) {
        self.queue.submit([encoder.finish()]);
        self.device
            .poll(wgpu::PollType::wait_indefinitely())
            .expect("the device answers");
    }

    /// Records, submits, waits; returns milliseconds by [`Gpu::stopwatch`]. Timestamps in compute passes are wrong on
    /// lavapipe once a render pass has run, so this is what works everywhere.
    #[cfg(feature = "native")]
    pub fn time<R>(&self, record: impl FnOnce(&mut wgpu::CommandEncoder) -> R) -> (f64, R) {
        let mut encoder = self.encoder();
        let result = record(&mut encoder);
        let stopwatch = self.stopwatch();
        self.finish(encoder);
        (stopwatch.milliseconds(), result)
    }

    /// What this adapter's work is timed by: the processor's time where the driver runs on it.
    #[cfg(feature = "native")]
    pub fn stopwatch(&self) -> Stopwatch {
        Stopwatch::start(self.on_processor())
    }

    /// Whether the driver is software.
    pub fn on_processor(&self) -> bool {
        self.adapter.device_type == wgpu::DeviceType::Cpu
    }

    pub fn encoder(&self) -> wgpu::CommandEncoder {
        self.device
            .create_command_encoder(&wgpu::CommandEncoderDescriptor::default())
    }

    /// The contents of a buffer with usage `COPY_SRC`.
    #[cfg(feature = "native")]
    pub fn read_buffer<T: bytemuck::Pod>(&self, buffer: &wgpu::Buffer) -> Vec<T> {
        let staging = self.staging(buffer.size());
        let mut encoder = self.encoder();
        encoder.copy_buffer_to_buffer(buffer, 0, &staging, 0, None);
        self.finish(encoder);
        pollster::block_on(self.map(&staging, |bytes| bytemuck::pod_collect_to_vec(bytes)))
    }

    /// The texels of one layer of a texture with usage `COPY_SRC`, rows from the top.
    #[cfg(feature = "native")]
    pub fn read_texture<T: bytemuck::Pod>(&self, texture: &wgpu::Texture, layer: u32) -> Vec<T> {
        pollster::block_on(self.read_texture_soon(texture, layer))
    }

    /// The same without blocking.
    pub async fn read_texture_soon<T: bytemuck::Pod>(
        &self,
        texture: &wgpu::Texture,
        layer: u32,
    ) -> Vec<T> {
        let most = self.device.limits().max_buffer_size;
        self.read_texture_by(texture, layer, most as usize).await
    }

    /// The same through buffers of at most so many bytes, and a row.
    pub async fn read_texture_by<T: bytemuck::Pod>(
        &self,
        texture: &wgpu::Texture,
        layer: u32,
        bytes: usize,
    ) -> Vec<T> {
        let size = wgpu::Extent3d {
            depth_or_array_layers: 1,
            ..texture.size()
        };
        let texel = size_of::<T>();
        let row = texel * size.width as usize;
        let padded = row.next_multiple_of(256);
        let band = size.height.min((bytes / padded).max(1) as u32);
        let mut texels = Vec::with_capacity((size.width * size.height) as usize);
        for top in (0..size.height).step_by(band as usize) {
            let height = band.min(size.height - top);
            let staging = self.staging((padded * height as usize) as u64);
            let mut encoder = self.encoder();
            encoder.copy_texture_to_buffer(
                wgpu::TexelCopyTextureInfo {
                    texture,
                    mip_level: 0,
                    origin: wgpu::Origin3d {
                        x: 0,
                        y: top,
                        z: layer,
                    },
                    aspect: wgpu::TextureAspect::All,
                },
                wgpu::TexelCopyBufferInfo {
                    buffer: &staging,
                    layout: wgpu::TexelCopyBufferLayout {
                        offset: 0,
                        bytes_per_row: Some(padded as u32),
                        rows_per_image: None,
                    },
                },
                wgpu::Extent3d { height, ..size },
            );
            self.finish(encoder);
            self.map(&staging, |bytes| {
                for row_of in bytes.chunks_exact(padded) {
                    texels.extend(bytemuck::pod_collect_to_vec::<u8, T>(&row_of[..row]));
                }
            })
            .await;
        }
        texels
    }

    /// A texture with contents, of a colour format.
    pub fn texture<T: bytemuck::Pod>(
        &self,
        format: wgpu::TextureFormat,
        width: u32,
        height: u32,
        texels: &[T],
    ) -> wgpu::TextureView {
        self.device
            .create_texture_with_data(
                &self.queue,
                &wgpu::TextureDescriptor {
                    label: None,
                    size: wgpu::Extent3d {
                        width,
                        height,
                        depth_or_array_layers: 1,
                    },
                    mip_level_count: 1,
                    sample_count: 1,
                    dimension: wgpu::TextureDimension::D2,
                    format,
                    usage: wgpu::TextureUsages::TEXTURE_BINDING,
                    view_formats: &[],
                },
                wgpu::util::TextureDataOrder::LayerMajor,
                bytemuck::cast_slice(texels),
            )
            .create_view(&wgpu::TextureViewDescriptor::default())
    }

    /// An empty texture to render to and read back.
    pub fn target(
        &self,
        format: wgpu::TextureFormat,
        width: u32,
        height: u32,
    ) -> wgpu::TextureView {
        let usage = wgpu::TextureUsages::RENDER_ATTACHMENT;
        self.empty(format, width, height, usage)
    }

    /// An empty texture for kernels to write and to read back.
    pub fn storage(
        &self,
        format: wgpu::TextureFormat,
        width: u32,
        height: u32,
    ) -> wgpu::TextureView {
        let usage = wgpu::TextureUsages::STORAGE_BINDING
            | wgpu::TextureUsages::RENDER_ATTACHMENT
            | wgpu::TextureUsages::COPY_DST;
        self.empty(format, width, height, usage)
    }

    fn empty(
        &self,
        format: wgpu::TextureFormat,
        width: u32,
        height: u32,
        written: wgpu::TextureUsages,
    ) -> wgpu::TextureView {
        self.device
            .create_texture(&wgpu::TextureDescriptor {
                label: None,
                size: wgpu::Extent3d {
                    width,
                    height,
                    depth_or_array_layers: 1,
                },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: written
                    | wgpu::TextureUsages::TEXTURE_BINDING
                    | wgpu::TextureUsages::COPY_SRC,
                view_formats: &[],
            })
            .create_view(&wgpu::TextureViewDescriptor::default())
    }

    fn staging(&self, size: u64) -> wgpu::Buffer {
        self.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size,
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        })
    }

    async fn map<R>(&self, staging: &wgpu::Buffer, read: impl FnOnce(&[u8]) -> R) -> R {
        let answer = Arc::new(Mutex::new(Answer::default()));
        let told = answer.clone();
        staging.map_async(wgpu::MapMode::Read, .., move |result| {
            let mut answer = told.lock().expect("nothing panics with it");
            answer.result = Some(result);
            if let Some(waker) = answer.waker.take() {
                waker.wake();
            }
        });
        // In a browser this does nothing, and the answer comes by itself.
        self.device
            .poll(wgpu::PollType::wait_indefinitely())
            .expect("the device answers");
        poll_fn(|context| {
            let mut answer = answer.lock().expect("nothing panics with it");
            if let Some(result) = answer.result.take() {
                Poll::Ready(result)
            } else {
                answer.waker = Some(context.waker().clone());
                Poll::Pending
            }
        })
        .await
        .expect("the buffer maps");
        read(&staging.get_mapped_range(..).expect("the buffer is mapped"))
    }
}

/// Whether a buffer is mapped, and who waits for it.
#[derive(Default)]
struct Answer {
    result: Option<Result<(), wgpu::BufferAsyncError>>,
    waker: Option<Waker>,
}
