//! What the page calls.

use deep_screen_space::{Quality, wgpu};
use js_sys::Promise;
use support::gpu::{Ask, Gpu};
use wasm_bindgen::prelude::*;
use web_sys::HtmlCanvasElement;

use crate::{
    frame::{Effect, Frame, compared},
    show::Show,
};

/// A canvas, and what is drawn on it.
#[wasm_bindgen]
pub struct Page {
    gpu: Gpu,
    surface: wgpu::Surface<'static>,
    format: wgpu::TextureFormat,
    size: [u32; 2],
    picture: wgpu::TextureView,
    frame: Frame,
    scene: String,
    show: Show,
}

/// A panic's message goes to the browser's console, which would show none otherwise.
#[wasm_bindgen(start)]
fn start() {
    std::panic::set_hook(Box::new(|info| {
        web_sys::console::error_1(&info.to_string().into())
    }));
}

fn parse(effect: &str, quality: &str) -> Result<(Effect, Quality), String> {
    let effect = Effect::by_name(effect).ok_or_else(|| format!("there is no effect {effect}"))?;
    let quality = match quality {
        "fast" => Quality::Fast,
        "balanced" => Quality::Balanced,
        "accurate" => Quality::Accurate,
        _ => return Err(format!("there is no quality {quality}")),
    };
    Ok((effect, quality))
}

#[wasm_bindgen]
impl Page {
    /// A picture of the canvas's size. The error says what the browser lacks.
    pub async fn open(
        canvas: HtmlCanvasElement,
        scene: String,
        effect: String,
        quality: String,
    ) -> Result<Page, String> {
        let gpu = Gpu::open_soon(Ask::Floor).await?;
        let size = [canvas.width(), canvas.height()];
        let surface = gpu
            .instance
            .create_surface(wgpu::SurfaceTarget::Canvas(canvas))
            .map_err(|e| e.to_string())?;
        // Every browser shows it.
        let format = wgpu::TextureFormat::Bgra8Unorm;
        surface.configure(
            &gpu.device,
            &wgpu::SurfaceConfiguration {
                color_space: wgpu::SurfaceColorSpace::Auto,
                usage: wgpu::TextureUsages::RENDER_ATTACHMENT,
                format,
                width: size[0],
                height: size[1],
                present_mode: wgpu::PresentMode::Fifo,
                desired_maximum_frame_latency: 2,
                alpha_mode: wgpu::CompositeAlphaMode::Opaque,
                view_formats: Vec::new(),
            },
        );
        let (effect, quality) = parse(&effect, &quality)?;
        let picture = gpu.target(Frame::FORMAT, size[0], size[1]);
        Ok(Self {
            frame: Frame::new(&gpu, &scene, effect, quality, size)?,
            show: Show::new(&gpu, effect, &picture, format),
            surface,
            format,
            size,
            picture,
            scene,
            gpu,
        })
    }

    /// Another scene, effect or quality.
    pub fn choose(&mut self, scene: &str, effect: &str, quality: &str) -> Result<(), String> {
        let (effect, quality) = parse(effect, quality)?;
        if scene == self.scene {
            self.frame.show(&self.gpu, effect, quality)?;
        } else {
            self.frame = Frame::new(&self.gpu, scene, effect, quality, self.size)?;
            self.scene = scene.into();
        }
        self.show = Show::new(&self.gpu, effect, &self.picture, self.format);
        Ok(())
    }

    /// Turns the camera around what it looks at, by radians.
    pub fn turn(&mut self, across: f64, up: f64) {
        self.frame.orbit.turn(across, up);
    }

    /// Multiplies its distance.
    pub fn approach(&mut self, factor: f64) {
        self.frame.orbit.approach(factor);
    }

    /// Draws a frame.
    pub fn draw(&mut self) -> Result<(), String> {
        let (wgpu::CurrentSurfaceTexture::Success(shown)
        | wgpu::CurrentSurfaceTexture::Suboptimal(shown)) = self.surface.get_current_texture()
        else {
            return Err("the canvas gives no texture to draw to".into());
        };
        let mut encoder = self.gpu.encoder();
        self.frame
            .record(&self.gpu, &mut encoder, self.picture.texture())
            .map_err(|e| e.to_string())?;
        let view = shown
            .texture
            .create_view(&wgpu::TextureViewDescriptor::default());
        self.show.record(&mut encoder, &view);
        self.gpu.queue.submit([encoder.finish()]);
        self.gpu.queue.present(shown);
        Ok(())
    }

    /// Is kept when the GPU has done all that was asked of it.
    pub fn done(&self) -> Promise {
        Promise::new(&mut |resolve, _| {
            self.gpu.queue.on_submitted_work_done(move || {
                // It takes no argument and cannot fail.
                let _ = resolve.call0(&JsValue::UNDEFINED);
            });
        })
    }
}

/// The picture that is compared with other drivers': four half floats a texel, as their bits.
#[wasm_bindgen]
pub async fn picture(effect: String) -> Result<Vec<u16>, String> {
    let (effect, _) = parse(&effect, "fast")?;
    let gpu = Gpu::open_soon(Ask::Floor).await?;
    Ok(compared(&gpu, effect).await?.as_flattened().to_vec())
}
