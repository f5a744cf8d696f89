//! Effects that read the G-buffer alone, on whole images and in parts.

use deep_screen_space::{
    BallSamples, Camera, Channels, Combine, DiskSamples, MultiResLevel, MultiResMask,
    MultiResMaskInput, MultiResMaskSettings, MultiResReconstructor, MultiResReconstructorInput,
    MultiResReconstructorSettings, ObscuranceInput, ObscuranceSampling, ObscuranceSettings,
    ObscuranceVolume, PixelList, ScreenSpaceGi, ScreenSpaceGiInput, ScreenSpaceGiSettings,
    SecondRadius, SoftShadows, SoftShadowsInput, SoftShadowsSettings, TextureSlice, Viewport,
    VolumetricObscurance, VolumetricObscuranceDescriptor,
    wgpu::{TextureFormat as Format, TextureUsages},
};

use super::{
    case::{Case, Kind},
    inputs::{self, Drawn, OwnWork, Part},
    surfels::Map,
};

/// One of the effects, with all that it is given.
enum Effect {
    Shadows(Map, deep_screen_space::Light, SoftShadowsSettings),
    Bounce(Part, ScreenSpaceGiSettings),
    Obscurance(ObscuranceSampling, ObscuranceVolume, ObscuranceSettings),
}

impl Effect {
    fn new(case: &mut Case<'_>, camera: &Camera) -> Self {
        match case.usual("effect", &[0, 1, 2]) {
            0 => {
                let settings = SoftShadowsSettings {
                    extent: case.random.scale(0.0, 1e18),
                    max_penumbra: case.random.scale(f32::MIN_POSITIVE, 1e18),
                    blockers: case.loops("blockers", 1024),
                    samples: case.loops("samples", 1024),
                    turn: case.random.chance(0.5),
                };
                case.note("soft shadows", settings);
                Self::Shadows(Map::new(case), inputs::light(case, camera.eye()), settings)
            }
            1 => {
                let formats = [Format::Rgba16Float, Format::Rgba32Float, Format::Rgba8Unorm];
                let format = case.usual("lit", &formats);
                let lit = inputs::image(case, "lit", format, camera.viewport(), |x, y| {
                    [(x % 3) as f32, (y % 4) as f32 * 100.0, 0.5, 1.0]
                });
                let settings = ScreenSpaceGiSettings {
                    radius: case.random.scale(f32::MIN_POSITIVE, 1e8),
                    samples: case.loops("points", 16384),
                    turn: case.random.chance(0.5),
                };
                case.note("screen-space gi", settings);
                Self::Bounce(lit, settings)
            }
            _ => {
                let samplings = [
                    ObscuranceSampling::Points(BallSamples::SixtyFour),
                    ObscuranceSampling::Lines(DiskSamples::Six),
                    ObscuranceSampling::Lines(DiskSamples::FifteenAround),
                    ObscuranceSampling::Areas(DiskSamples::Five),
                    ObscuranceSampling::OneArea,
                ];
                let sampling = case.usual("sampling", &samplings);
                let volume = if matches!(sampling, ObscuranceSampling::Areas(_)) {
                    ObscuranceVolume::Sphere
                } else {
                    let volumes = [
                        ObscuranceVolume::Sphere,
                        ObscuranceVolume::Hemisphere,
                        ObscuranceVolume::TangentSphere,
                    ];
                    case.usual("volume", &volumes)
                };
                let second = SecondRadius {
                    radius: case.random.scale(0.0, f32::INFINITY),
                    combine: case.random.one_of(&[Combine::Product, Combine::Minimum]),
                };
                let settings = ObscuranceSettings {
                    radius: case.random.scale(0.0, f32::INFINITY),
                    second: case.random.chance(0.3).then_some(second),
                    max_pixels: case.random.scale(f32::MIN_POSITIVE, 16384.0),
                    thickness: case.random.scale(f32::MIN_POSITIVE, f32::INFINITY),
                    box_half_width: case.random.setting(f32::MIN_POSITIVE, 4.0),
                    turn: case.random.chance(0.5),
                    seed: case.random.bits() as u32,
                };
                case.note("obscurance", (sampling, volume, settings));
                Self::Obscurance(sampling, volume, settings)
            }
        }
    }

    fn channels(&self) -> Channels {
        match self {
            Self::Bounce(..) => Channels::Three,
            _ => Channels::One,
        }
    }

    fn format(&self) -> Format {
        match self {
            Self::Bounce(..) => Format::Rgba16Float,
            _ => Format::R32Float,
        }
    }

    fn record(
        &self,
        case: &mut Case<'_>,
        (drawn, camera): (&Drawn, &Camera),
        work: Option<PixelList<'_>>,
        target: TextureSlice<'_>,
    ) -> Option<()> {
        let device = case.device();
        let gbuffer = drawn.gbuffer();
        let timestamps = case.timestamps();
        let done = match self {
            Self::Shadows(map, light, settings) => {
                let shadows = case.once("", |device| SoftShadows::new(device))?;
                let input = SoftShadowsInput {
                    gbuffer,
                    camera,
                    light,
                    map: map.map(),
                    work,
                    target,
                    timestamps,
                };
                shadows.record(device, &mut case.encoder, &input, settings)
            }
            Self::Bounce(lit, settings) => {
                let bounce = case.once("", |device| ScreenSpaceGi::new(device))?;
                let input = ScreenSpaceGiInput {
                    gbuffer,
                    camera,
                    lit: lit.slice(),
                    work,
                    target,
                    timestamps,
                };
                bounce.record(device, &mut case.encoder, &input, settings)
            }
            &Self::Obscurance(sampling, volume, settings) => {
                let pass = case.once((sampling, volume), |device| {
                    let descriptor = VolumetricObscuranceDescriptor { sampling, volume };
                    VolumetricObscurance::new(device, &descriptor)
                })?;
                let Viewport { width, height, .. } = camera.viewport();
                let areas = [
                    ObscuranceSampling::OneArea,
                    ObscuranceSampling::Areas(DiskSamples::Five),
                ];
                let moments = if areas.contains(&sampling) && !case.random.breaks() {
                    let moments = pass.create_moments(device, width, height);
                    let moments = case.accept(moments)?;
                    let depth = drawn.depth.slice();
                    let stamps = case.timestamps();
                    let done = pass.record_moments(
                        device,
                        &mut case.encoder,
                        depth,
                        camera,
                        &moments,
                        stamps,
                    );
                    case.accept(done)?;
                    case.buffer("moments", moments.buffer(), Kind::Floats);
                    Some(moments)
                } else {
                    None
                };
                let input = ObscuranceInput {
                    depth: drawn.depth.slice(),
                    normals: Some(gbuffer.normals()),
                    camera,
                    moments: moments.as_ref(),
                    work,
                    target,
                    timestamps,
                };
                pass.record(device, &mut case.encoder, &input, &settings)
            }
        };
        case.accept(done)
    }
}

fn mask_settings(case: &mut Case<'_>) -> MultiResMaskSettings {
    let random = &mut case.random;
    let presets = [
        MultiResMaskSettings::OCCLUSION,
        MultiResMaskSettings::SHADOW,
        MultiResMaskSettings::INDIRECT,
    ];
    let mut settings = random.one_of(&presets);
    if random.chance(0.6) {
        settings = MultiResMaskSettings {
            levels: std::array::from_fn(|_| {
                random.chance(0.6).then(|| MultiResLevel {
                    variance: random.setting(0.0, 16.0),
                    weight: random.scale(0.0, f32::INFINITY),
                    threshold: random.setting(0.0, 1.0),
                })
            }),
            normal_threshold: random.scale(f32::MIN_POSITIVE, f32::INFINITY),
            depth_threshold: random.scale(f32::MIN_POSITIVE, f32::INFINITY),
            shading_threshold: random.scale(f32::MIN_POSITIVE, f32::INFINITY),
        };
        if settings.levels.iter().all(Option::is_none) && !random.breaks() {
            settings.levels[random.below(4) as usize] = Some(MultiResLevel::new(1.0, 10.0));
        }
    }
    case.note("mask", settings);
    settings
}

pub fn record(case: &mut Case<'_>) {
    let _ = steps(case);
}

fn steps(case: &mut Case<'_>) -> Option<()> {
    let camera = inputs::camera(case);
    let drawn = inputs::gbuffer(case, &camera, false);
    let effect = Effect::new(case, &camera);
    let viewport = camera.viewport();
    if case.random.chance(0.4) {
        return whole(case, &effect, &drawn, &camera);
    }
    let device = case.device();
    let Viewport { width, height, .. } = viewport;
    let mask = case.once("", |device| MultiResMask::new(device))?;
    let stencils = case.random.chance(0.3);
    let masks = mask.create_view(device, width, height, stencils);
    let mut masks = case.accept(masks)?;
    let own: [Option<Part>; 3] = ["shading", "edges", "importance"].map(|name| {
        case.random.chance(0.3).then(|| {
            let formats = [Format::R32Float, Format::R8Unorm, Format::Rgba16Float];
            let format = case.usual(name, &formats);
            inputs::image(case, name, format, viewport, |x, y| {
                [((x ^ y) % 5) as f32 * 0.25, 0.0, 0.0, 0.0]
            })
        })
    });
    let [shading, edges, importance] = own.each_ref().map(|part| part.as_ref().map(Part::slice));
    let settings = mask_settings(case);
    let input = MultiResMaskInput {
        gbuffer: drawn.gbuffer(),
        camera: &camera,
        shading,
        edges,
        importance,
        timestamps: case.timestamps(),
    };
    let done = mask.record(device, &mut case.encoder, &input, &settings, &mut masks);
    case.accept(done)?;
    for level in 0..4 {
        if let Some(mask) = masks.mask(level) {
            case.texture("mask", mask.texture());
        }
        if let Some(work) = masks.work(level) {
            case.buffer("pixels", work.pixels, Kind::Bits);
        }
    }

    let format = inputs::target_format(case);
    let channels = effect.channels();
    let blend = case.once((channels, format), |device| {
        MultiResReconstructor::new(device, channels, format)
    })?;
    let images = blend.create_images(device, width, height, &settings);
    let images = case.accept(images)?;
    for work in masks.works() {
        let image = images.level(work.level)?;
        effect.record(case, (&drawn, &camera), Some(work), image.into())?;
        case.texture("sub-image", image);
    }
    let target = inputs::target(case, format, viewport, TextureUsages::RENDER_ATTACHMENT);
    let settings = MultiResReconstructorSettings {
        plane_distance: case.random.scale(f32::MIN_POSITIVE, f32::MAX),
        normal_power: case.random.scale(8.0, 1000.0),
    };
    case.note("blend", settings);
    let input = MultiResReconstructorInput {
        gbuffer: drawn.gbuffer(),
        camera: &camera,
        masks: &masks,
        images: &images,
        target: target.slice(),
        timestamps: case.timestamps(),
    };
    let done = blend.record(device, &mut case.encoder, &input, &settings);
    case.accept(done)?;
    case.texture("blended", &target.texture);
    Some(())
}

/// Into a texture of the caller's, of all pixels or those of its own list.
fn whole(case: &mut Case<'_>, effect: &Effect, drawn: &Drawn, camera: &Camera) -> Option<()> {
    let viewport = camera.viewport();
    let work = case
        .random
        .chance(0.3)
        .then(|| OwnWork::new(case, viewport));
    let work = work.as_ref().map(OwnWork::list);
    let mut format = effect.format();
    if case.random.breaks() {
        format = case
            .random
            .one_of(&[Format::Rgba8Unorm, Format::Rgba32Float]);
    }
    let size = Viewport::full(viewport.width, viewport.height);
    let target = inputs::target(case, format, size, TextureUsages::STORAGE_BINDING);
    effect.record(case, (drawn, camera), work, target.slice())?;
    case.texture("effect", &target.texture);
    Some(())
}
