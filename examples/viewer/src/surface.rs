//! The window's surface: of whatever size, lost or not.

use std::{
    pin::pin,
    sync::Arc,
    task::{Context, Poll, Waker},
};

use deep_screen_space::wgpu;
use support::gpu::{Ask, Gpu};
use winit::window::Window;

/// A surface, and how it is configured.
pub struct Surface {
    instance: wgpu::Instance,
    window: Arc<Window>,
    shown: wgpu::Surface<'static>,
    config: wgpu::SurfaceConfiguration,
    /// Whether it has an extent.
    open: bool,
    /// Whether it is yet to be configured.
    stale: bool,
}

impl Surface {
    /// A device that can present to a window, and the surface.
    ///
    /// # Errors
    /// A line that says what there is none of.
    pub fn open(instance: wgpu::Instance, window: &Arc<Window>) -> Result<(Gpu, Self), String> {
        let surface = instance
            .create_surface(Arc::clone(window))
            .map_err(|e| format!("no surface: {e}"))?;
        let (gpu, adapter) = Gpu::open_for(&instance, &surface, Ask::UsefulRoom)?;
        let capabilities = surface.get_capabilities(&adapter);
        // The display encodes by itself, and egui is made for it.
        let plain = capabilities.formats.iter().find(|f| !f.is_srgb());
        let format = *plain
            .or(capabilities.formats.first())
            .ok_or("the adapter cannot show the window")?;
        let config = wgpu::SurfaceConfiguration {
            present_mode: wgpu::PresentMode::AutoVsync,
            desired_maximum_frame_latency: 2,
            ..surface
                .get_default_config(&adapter, 1, 1)
                .ok_or("the adapter cannot show the window")?
        };
        let config = wgpu::SurfaceConfiguration { format, ..config };
        let mut opened = Self {
            instance,
            window: Arc::clone(window),
            shown: surface,
            config,
            open: false,
            stale: true,
        };
        opened.resize(&gpu);
        Ok((gpu, opened))
    }

    pub fn format(&self) -> wgpu::TextureFormat {
        self.config.format
    }

    /// In pixels, 1 at least.
    pub fn size(&self) -> [u32; 2] {
        [self.config.width, self.config.height]
    }

    /// Takes the window's size. Of nothing, it pauses.
    pub fn resize(&mut self, gpu: &Gpu) {
        let size = self.window.inner_size();
        self.open = size.width > 0 && size.height > 0;
        let most = gpu.device.limits().max_texture_dimension_2d;
        let size = [size.width.min(most), size.height.min(most)];
        if self.open && (self.stale || self.size() != size) {
            [self.config.width, self.config.height] = size;
            self.configure(gpu);
        }
    }

    /// It is refused while another thread submits, as one does that loads or calibrates: then the next frame tries again.
    fn configure(&mut self, gpu: &Gpu) {
        let scope = gpu.device.push_error_scope(wgpu::ErrorFilter::Validation);
        self.shown.configure(&gpu.device, &self.config);
        let refused = pin!(scope.pop()).poll(&mut Context::from_waker(Waker::noop()));
        self.stale = !matches!(refused, Poll::Ready(None));
    }

    /// Whether there is anything to draw to.
    pub fn is_open(&self) -> bool {
        self.open
    }

    /// What to draw the next frame to; `None` where there is none now, and the next one is to be tried.
    pub fn next(&mut self, gpu: &Gpu) -> Option<wgpu::SurfaceTexture> {
        if self.stale {
            self.configure(gpu);
        }
        if self.stale {
            return None;
        }
        match self.shown.get_current_texture() {
            wgpu::CurrentSurfaceTexture::Success(texture)
            | wgpu::CurrentSurfaceTexture::Suboptimal(texture) => Some(texture),
            wgpu::CurrentSurfaceTexture::Outdated => {
                self.stale = true;
                self.resize(gpu);
                None
            }
            wgpu::CurrentSurfaceTexture::Lost => {
                if let Ok(surface) = self.instance.create_surface(Arc::clone(&self.window)) {
                    self.shown = surface;
                    self.stale = true;
                    self.resize(gpu);
                }
                None
            }
            wgpu::CurrentSurfaceTexture::Timeout
            | wgpu::CurrentSurfaceTexture::Occluded
            | wgpu::CurrentSurfaceTexture::Validation => None,
        }
    }
}
