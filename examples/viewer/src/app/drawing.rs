//! Both sides and the panel, into the window or into a file.

use std::path::PathBuf;

use deep_screen_space::wgpu::{self, TextureFormat, TextureView};
use egui_wgpu::ScreenDescriptor;

use super::State;
use crate::display::{Arrangement, Shown, Side};

impl State {
    /// Draws both sides and the panel into the window, or into the file that a script asks for. False where the window takes no
    /// picture now.
    pub(super) fn present(&mut self, output: egui::FullOutput) -> Result<bool, String> {
        let egui::FullOutput {
            platform_output,
            mut textures_delta,
            shapes,
            pixels_per_point,
            ..
        } = output;
        self.input
            .handle_platform_output(&self.window, platform_output);
        let (device, queue) = (&self.gpu.device, &self.gpu.queue);
        for (id, deltas) in std::mem::take(&mut textures_delta.set) {
            for delta in deltas {
                self.painter.update_texture(device, queue, id, &delta);
            }
        }
        let jobs = self.input.egui_ctx().tessellate(shapes, pixels_per_point);
        if let Some(path) = self.shot.take() {
            let [width, height] = self.surface.size();
            let target = self.gpu.target(self.surface.format(), width, height);
            self.draw(&target, &jobs, pixels_per_point);
            self.write_shot(&path, &target)?;
        }
        let next = self.surface.next(&self.gpu);
        let shown = next.is_some();
        if let Some(texture) = next {
            let view = texture
                .texture
                .create_view(&wgpu::TextureViewDescriptor::default());
            self.draw(&view, &jobs, pixels_per_point);
            self.window.pre_present_notify();
            self.gpu.queue.present(texture);
        }
        for id in std::mem::take(&mut textures_delta.free) {
            self.painter.free_texture(&id);
        }
        // Nothing else waits for the device, which has to say what it is done with.
        let polled = self.gpu.device.poll(wgpu::PollType::Poll);
        polled
            .map(|_| shown)
            .map_err(|e| format!("the device: {e}"))
    }

    fn draw(
        &mut self,
        target: &TextureView,
        jobs: &[egui::ClippedPrimitive],
        pixels_per_point: f32,
    ) {
        let gpu = &self.gpu;
        let mut encoder = gpu.encoder();
        let screen = ScreenDescriptor {
            size_in_pixels: self.surface.size(),
            pixels_per_point,
        };
        let buffers =
            self.painter
                .update_buffers(&gpu.device, &gpu.queue, &mut encoder, jobs, &screen);
        let shared = self.panel.looks[0].shares_truth(&self.panel.looks[1]);
        let side = |side: usize| {
            let passes = self.sides.passes(side)?;
            Some(Side {
                picture: passes.target(),
                look: &self.panel.looks[side],
                // The truth is about the first side's effect.
                shown: match self.panel.shown {
                    _ if side == 1 && !shared => Shown::Picture,
                    _ if !self.truth.is_asked() => Shown::Picture,
                    shown => shown,
                },
            })
        };
        let is_seen = self.area[2] > 0 && self.area[3] > 0;
        let load = if let Some(first) = side(0).filter(|_| is_seen) {
            let arrangement = Arrangement {
                first,
                second: side(1).filter(|_| self.panel.compare),
                truth: &self.known,
                area: self.area,
                split: self.panel.split,
                exposure: self.panel.exposure,
                gain: self.panel.gain,
            };
            self.display.record(gpu, &mut encoder, &arrangement, target);
            wgpu::LoadOp::Load
        } else {
            wgpu::LoadOp::Clear(wgpu::Color::BLACK)
        };
        let pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("panel"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: target,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load,
                    store: wgpu::StoreOp::Store,
                },
            })],
            ..Default::default()
        });
        self.painter
            .render(&mut pass.forget_lifetime(), jobs, &screen);
        let commands = buffers.into_iter().chain([encoder.finish()]);
        gpu.queue.submit(commands);
    }

    fn write_shot(&self, path: &PathBuf, target: &TextureView) -> Result<(), String> {
        let texture = target.texture();
        let mut texels: Vec<[u8; 4]> = self.gpu.read_texture(texture, 0);
        let is_turned = matches!(
            texture.format(),
            TextureFormat::Bgra8Unorm | TextureFormat::Bgra8UnormSrgb
        );
        for texel in &mut texels {
            if is_turned {
                texel.swap(0, 2);
            }
        }
        let bytes: Vec<u8> = texels.iter().flat_map(|t| [t[0], t[1], t[2]]).collect();
        let (width, height) = (texture.width(), texture.height());
        image::save_buffer(path, &bytes, width, height, image::ColorType::Rgb8)
            .map_err(|e| format!("{}: {e}", path.display()))
    }
}
