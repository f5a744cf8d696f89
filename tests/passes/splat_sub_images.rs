//! Splatting and reconstruction on sub-images: listed pixels are those of the whole image, and what a multi-resolution mask
//! blends of them is near it.

use deep_screen_space::{
    AmbientOcclusion, Camera, Channels, CloudCapacity, ClusterInput, Effect, Error, GBuffer,
    Geometry, MultiResMaskSettings, MultiResReconstructor, MultiResReconstructorInput,
    MultiResReconstructorSettings, PixelList, Reconstructor, ReconstructorInput,
    ReconstructorSettings, ShellSplatter, SplatInput, SplatSettings, SurfelCloud, SurfelClusters,
    SurfelizerInput, SurfelizerSettings, Viewport, scenes,
    wgpu::{self, TextureFormat as Format, TextureView},
};
use support::testing::frames::Decoded;
use support::testing::multi_res;
use support::testing::multi_res::{Frame, check_work};
use support::testing::pipelines;
use support::testing::shot::{Shot, camera_in, camera_of};
use support::{errors::rmse, gpu::Gpu};

/// Surfels of what a shot shows, and the passes for an effect.
struct Splats<'a> {
    gpu: &'a Gpu,
    shot: &'a Shot,
    settings: SplatSettings,
    splatter: &'static ShellSplatter,
    reconstructor: &'static Reconstructor,
    cloud: SurfelCloud,
    clusters: SurfelClusters,
    /// Another one at each texel.
    roughness: TextureView,
}

impl<'a> Splats<'a> {
    fn new(gpu: &'a Gpu, shot: &'a Shot, effect: &Effect, settings: SplatSettings) -> Self {
        let device = &gpu.device;
        let surfelizer = pipelines::surfelizer();
        let splatter = pipelines::shell_splatter(effect, false);
        let capacity = CloudCapacity {
            surfels: 1 << 17,
            pieces: 1 << 16,
            triangles: 1 << 16,
        };
        let mut cloud = surfelizer.create_cloud(device, capacity).expect("a cloud");
        let mut clusters = splatter
            .create_clusters(device, &cloud, settings.levels)
            .expect("clusters");
        let mut encoder = gpu.encoder();
        let meshes = shot.buffers.meshes();
        let input = SurfelizerInput {
            geometry: Geometry { meshes: &meshes },
            camera: &shot.camera,
            cull_by: &[shot.camera],
            timestamps: None,
        };
        let surfels = SurfelizerSettings {
            radius_pixels: 3.0,
            reach: ShellSplatter::reach(&settings),
            ..SurfelizerSettings::default()
        };
        surfelizer
            .record(device, &mut encoder, &input, &surfels, &mut cloud)
            .expect("surfels");
        let input = ClusterInput::new(&cloud);
        splatter
            .record_clusters(device, &mut encoder, &input, &settings, &mut clusters)
            .expect("clusters");
        gpu.finish(encoder);
        let viewport = shot.camera.viewport();
        let [right, bottom] = [viewport.x + viewport.width, viewport.y + viewport.height];
        let texels = (0..right * bottom).map(|i| (i * 37 % 101) as f32 / 100.0);
        let texels: Vec<f32> = texels.collect();
        Self {
            roughness: gpu.texture(Format::R32Float, right, bottom, &texels),
            gpu,
            shot,
            settings,
            splatter,
            reconstructor: pipelines::reconstructor(effect, Format::R32Float),
            cloud,
            clusters,
        }
    }

    fn camera(&self) -> &Camera {
        &self.shot.camera
    }

    fn size(&self) -> [u32; 2] {
        let viewport = self.camera().viewport();
        [viewport.width, viewport.height]
    }

    fn record(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        work: Option<PixelList<'_>>,
        target: &wgpu::Texture,
    ) -> Result<(), Error> {
        let device = &self.gpu.device;
        let sub_image = work.as_ref().map_or(0, |work| work.level);
        let [width, height] = self.size().map(|n| n.div_ceil(1 << sub_image));
        let levels = self.settings.levels;
        let sums = self.splatter.create_view(device, width, height, levels)?;
        let scratch = self.reconstructor.create_view(device, &sums)?;
        let gbuffer = GBuffer {
            roughness: Some(self.roughness.texture().into()),
            ..self.shot.lit_gbuffer()
        };
        let mut decoded = Decoded::of(self.camera());
        let frame = decoded.record(encoder, gbuffer, self.camera(), self.cloud.origin())?;
        let input = SplatInput {
            work,
            ..SplatInput::new(&frame, &self.cloud, &self.clusters)
        };
        self.splatter
            .record(device, encoder, &input, &self.settings, &sums)?;
        // Sub-images are written from the corner, the whole where the viewport is.
        let viewport = self.camera().viewport();
        let [right, bottom] = [viewport.x + viewport.width, viewport.y + viewport.height];
        let whole = (work.is_none() && [right, bottom] != self.size())
            .then(|| self.gpu.target(Format::R32Float, right, bottom));
        let written = whole.as_ref().map_or(target, |whole| whole.texture());
        let input = ReconstructorInput::new(&frame, &sums, written);
        let settings = ReconstructorSettings::default();
        self.reconstructor
            .record(device, encoder, &input, &settings, &scratch)?;
        if let Some(whole) = &whole {
            let mut from = whole.texture().as_image_copy();
            from.origin = wgpu::Origin3d {
                x: viewport.x,
                y: viewport.y,
                z: 0,
            };
            encoder.copy_texture_to_texture(from, target.as_image_copy(), target.size());
        }
        Ok(())
    }
}

/// Occlusion times the red of the albedo, the roughness and something of the view: nothing where there is no surface.
fn tinted() -> Effect {
    let mut effect = AmbientOcclusion::default().effect();
    let start = effect.source.find("fn resolve").expect("the last function");
    let source = effect.source[..start].replace("fn contribution", "fn factor");
    effect.source = (source
        + "fn contribution(
  sender: Sender, receiver_normal: vec3f, to_sender: vec3f, distance2: f32, receiver: Receiver,
) -> f32 {
  let factor = factor(sender, receiver_normal, to_sender, distance2);
  return factor * receiver.roughness * (1.5 + receiver.to_eye.x);
}
fn resolve(sum: f32, albedo: vec3f, receiver: Receiver) -> vec4f {
  let shown = sum * albedo.x * (0.2 + receiver.roughness) * (1.5 - receiver.to_eye.x);
  return vec4f(select(0.0, shown, sum > 0.0));
}\n")
        .into();
    effect.albedo = true;
    effect.view = true;
    effect.roughness = true;
    effect.label = "tinted".into();
    effect
}

#[test]
fn listed_pixels_are_those_of_the_whole_image() {
    let gpu = pipelines::gpu();
    let scene = scenes::colonnade();
    // Sides that no level divides.
    for (x, y) in [(0, 0), (5, 3)] {
        let viewport = Viewport {
            x,
            y,
            ..Viewport::full(75, 53)
        };
        let shot = Shot::new(gpu, &scene, &camera_in(&scene, 0, viewport));
        // One level has no noise: what a pixel sees does not depend on which others there are.
        let settings = SplatSettings {
            levels: 1,
            radius: 1.0,
            ..SplatSettings::default()
        };
        let splats = Splats::new(gpu, &shot, &tinted(), settings);
        let frame = Frame::of_shot(gpu, &shot);
        check_work(gpu, &frame, Format::R32Float, |encoder, work, target| {
            splats
                .record(encoder, work, target.texture())
                .expect("an image");
        });
    }
}

#[test]
fn sub_images_blend_to_the_whole_image() {
    let gpu = pipelines::gpu();
    let device = &gpu.device;
    let scene = scenes::colonnade();
    let shot = Shot::new(gpu, &scene, &camera_of(&scene, 0, [160, 96]));
    let effect = AmbientOcclusion::default().effect();
    let splats = Splats::new(
        gpu,
        &shot,
        &effect,
        SplatSettings {
            levels: 3,
            ..SplatSettings::default()
        },
    );
    let [width, height] = splats.size();
    let whole = gpu.target(Format::R32Float, width, height);
    let blended = gpu.target(Format::R32Float, width, height);
    let mask_settings = MultiResMaskSettings::OCCLUSION;
    let mask = pipelines::multi_res_mask();
    let frame = Frame::of_shot(gpu, &shot);
    let masks = multi_res::record(gpu, mask, &frame.input(), &mask_settings);
    let blend =
        MultiResReconstructor::new(device, Channels::One, Format::R32Float).expect("pipelines");
    let images = blend
        .create_images(device, width, height, &mask_settings)
        .expect("images");
    let mut encoder = gpu.encoder();
    splats
        .record(&mut encoder, None, whole.texture())
        .expect("an image");
    for work in masks.works() {
        let target = images.level(work.level).expect("a level");
        splats
            .record(&mut encoder, Some(work), target)
            .expect("an image");
    }
    let input = MultiResReconstructorInput {
        gbuffer: shot.gbuffer(),
        camera: &shot.camera,
        masks: &masks,
        images: &images,
        target: blended.texture().into(),
        timestamps: None,
    };
    blend
        .record(
            device,
            &mut encoder,
            &input,
            &MultiResReconstructorSettings::default(),
        )
        .expect("an image");
    gpu.finish(encoder);
    let read = |view: &TextureView| -> Vec<f32> { gpu.read_texture(view.texture(), 0) };
    let off = rmse(&read(&blended), &read(&whole));
    println!("off by {off:.4}");
    // 0.024 here: a coarse pixel's occlusion is not that of all pixels about it, and the levels' noise has fewer neighbours to
    // be smoothed over.
    assert!(off < 0.03, "{off}");
}

#[test]
fn what_does_not_fit_is_refused() {
    let gpu = pipelines::gpu();
    let scene = scenes::cornell();
    let shot = Shot::new(gpu, &scene, &camera_of(&scene, 0, [16, 12]));
    let effect = AmbientOcclusion::default().effect();
    let settings = SplatSettings {
        levels: 1,
        ..SplatSettings::default()
    };
    let splats = Splats::new(gpu, &shot, &effect, settings);
    let mask = pipelines::multi_res_mask();
    let frame = Frame::of_shot(gpu, &shot);
    let masks = multi_res::record(gpu, mask, &frame.input(), &MultiResMaskSettings::OCCLUSION);
    let work = masks.work(1).expect("a level");
    let refusal = |work: PixelList<'_>, target: [u32; 2]| {
        let target = gpu.target(Format::R32Float, target[0], target[1]);
        let refused = splats.record(&mut gpu.encoder(), Some(work), target.texture());
        refused.expect_err("it does not fit").to_string()
    };
    let beyond = refusal(PixelList { level: 4, ..work }, [16, 12]);
    assert!(
        beyond.contains("PixelList::level") && beyond.contains('4'),
        "{beyond}"
    );
    let small = refusal(PixelList { level: 0, ..work }, [16, 12]);
    assert!(small.contains("PixelList::pixels"), "{small}");
    let target = refusal(work, [7, 6]);
    assert!(target.contains("8x6"), "{target}");
}
