//! `NearFieldView`: the same as the passes by hand, over sizes, and what it refuses.

use std::sync::LazyLock;

use deep_screen_space::{
    Camera, DiskSamples, MultiResMaskSettings, NearFieldDescriptor, NearFieldEffect,
    NearFieldInput, NearFieldSource, NearFieldView, ObscuranceInput, ObscuranceSampling,
    ObscuranceSettings, ObscuranceVolume, Quality, SoftShadowsSettings, Viewport,
    VolumetricObscurance, VolumetricObscuranceDescriptor,
    glam::DMat4,
    scenes,
    wgpu::{self, TextureFormat as Format},
};
use support::{
    multires::{Masked, read_image},
    near::{Effect, Passes, Stage},
    testing::{pipelines, refusals::refused},
};

/// All that the example has, compiled once.
fn passes() -> &'static Passes {
    static PASSES: LazyLock<Passes> =
        LazyLock::new(|| Passes::new(&pipelines::gpu().device).expect("pipelines"));
    &PASSES
}

/// Few samples: what is compared is wiring.
fn samples(effect: Effect) -> u32 {
    match effect {
        Effect::Obscurance => 6,
        _ => 8,
    }
}

fn view(descriptor: &NearFieldDescriptor) -> NearFieldView {
    NearFieldView::new(&pipelines::gpu().device, descriptor).expect("pipelines")
}

fn effect_of(stage: &Stage<'_>, effect: Effect) -> NearFieldEffect {
    stage.effect(effect, samples(effect)).expect("a table")
}

fn draw(view: &mut NearFieldView, input: &NearFieldInput<'_>) -> Vec<[f32; 3]> {
    let gpu = pipelines::gpu();
    let mut encoder = gpu.encoder();
    view.record(&gpu.device, &mut encoder, input)
        .expect("what the effect needs");
    gpu.finish(encoder);
    read_image(gpu, input.target.texture)
}

#[test]
fn pictures_are_those_of_the_passes_by_hand() {
    let gpu = pipelines::gpu();
    let passes = passes();
    let scene = scenes::by_name("colonnade").expect("a scene");
    let sizes = [[64, 48], [97, 73]];
    let stages = sizes.map(|size| Stage::new(gpu, passes, &scene, 0, size).expect("a view"));
    for effect in Effect::ALL {
        let settings = effect_of(&stages[0], effect);
        let mut at_all = view(&NearFieldDescriptor::new(settings));
        let mut by_masks = view(&NearFieldDescriptor {
            masks: Some(effect.mask()),
            ..NearFieldDescriptor::by_masks(settings, effect.format())
        });
        assert_eq!([at_all.memory_bytes(), by_masks.memory_bytes()], [0; 2]);
        for (first, stage) in [(true, &stages[0]), (false, &stages[1])] {
            let size = stage.size();
            let input = |target| NearFieldInput {
                source: stage.source(effect),
                ..NearFieldInput::new(stage.drawn.gbuffer(), &stage.camera, target)
            };
            let whole = gpu.storage(effect.format(), size[0], size[1]);
            let found = draw(&mut at_all, &input(whole.texture()));
            let blended = gpu.target(effect.format(), size[0], size[1]);
            let found_by_masks = draw(&mut by_masks, &input(blended.texture()));
            // What has another size is made anew: the second one's is what counts.
            if first {
                continue;
            }
            let mut encoder = gpu.encoder();
            let full = gpu.storage(effect.format(), size[0], size[1]);
            let what = (effect, samples(effect));
            passes
                .record(stage, &mut encoder, what, None, full.texture())
                .expect("an effect");
            let mut masked = Masked::new(gpu, passes, effect, effect.mask(), size).expect("masks");
            masked
                .record_masks(passes, stage, &mut encoder)
                .and_then(|()| masked.record_images(passes, stage, &mut encoder, what.1))
                .and_then(|()| masked.record_blend(stage, &mut encoder))
                .expect("an effect by masks");
            gpu.finish(encoder);

            assert_eq!(found, read_image(gpu, full.texture()), "{effect:?}");
            let values = found.iter().map(|pixel| pixel[0]);
            let (low, high) = values.fold((1.0_f32, 0.0_f32), |(l, h), v| (l.min(v), h.max(v)));
            assert!(high - low > 0.05, "{effect:?} shows something");

            assert_eq!(
                found_by_masks,
                read_image(gpu, masked.target.texture()),
                "{effect:?}"
            );
            let hard = match effect {
                Effect::Shadow => 4 * u64::from(size[0] * size[1]),
                _ => 0,
            };
            assert_eq!(at_all.memory_bytes(), 0, "{effect:?}");
            assert_eq!(
                by_masks.memory_bytes(),
                masked.masks.memory_bytes() + masked.images.memory_bytes() + hard,
                "{effect:?}"
            );
        }
    }
}

#[test]
fn areas_have_the_moments_of_each_frame() {
    let gpu = pipelines::gpu();
    let passes = passes();
    let scene = scenes::by_name("colonnade").expect("a scene");
    let descriptor = VolumetricObscuranceDescriptor {
        sampling: ObscuranceSampling::Areas(DiskSamples::Five),
        volume: ObscuranceVolume::Sphere,
    };
    let settings = ObscuranceSettings {
        radius: 0.5,
        ..ObscuranceSettings::default()
    };
    let effect = NearFieldEffect::Obscurance {
        descriptor,
        settings,
    };
    let mut found = view(&NearFieldDescriptor::new(effect));
    let pass = VolumetricObscurance::new(&gpu.device, &descriptor).expect("pipelines");
    for [width, height] in [[40, 30], [24, 32]] {
        let stage = Stage::new(gpu, passes, &scene, 0, [width, height]).expect("a view");
        let gbuffer = stage.drawn.gbuffer();
        let target = gpu.storage(Format::R32Float, width, height);
        let input = NearFieldInput::new(gbuffer, &stage.camera, target.texture());
        let picture = draw(&mut found, &input);

        let by_hand = gpu.storage(Format::R32Float, width, height);
        let moments = pass
            .create_moments(&gpu.device, width, height)
            .expect("room");
        let mut encoder = gpu.encoder();
        let input = ObscuranceInput {
            moments: Some(&moments),
            ..ObscuranceInput::new(gbuffer.depth, &stage.camera, by_hand.texture())
        };
        pass.record_moments(
            &gpu.device,
            &mut encoder,
            gbuffer.depth,
            &stage.camera,
            &moments,
            None,
        )
        .and_then(|()| pass.record(&gpu.device, &mut encoder, &input, &settings))
        .expect("valid");
        gpu.finish(encoder);
        assert_eq!(picture, read_image(gpu, by_hand.texture()));
        assert_eq!(found.memory_bytes(), moments.memory_bytes());
    }
}

#[test]
fn what_does_not_go_together_is_refused() {
    let gpu = pipelines::gpu();
    let device = &gpu.device;
    let passes = passes();
    let scene = scenes::by_name("colonnade").expect("a scene");
    let stage = Stage::new(gpu, passes, &scene, 0, [32, 24]).expect("a view");
    let obscurance = NearFieldEffect::obscurance(0.5, Quality::Fast);
    let new = |descriptor: NearFieldDescriptor| NearFieldView::new(device, &descriptor);

    let of_bytes = NearFieldDescriptor {
        target: Format::R8Unorm,
        ..NearFieldDescriptor::new(obscurance)
    };
    refused(
        new(of_bytes),
        "Mismatch",
        "NearFieldDescriptor::target",
        "R32Float",
    );
    let of_integers = NearFieldDescriptor::by_masks(obscurance, Format::R8Uint);
    refused(new(of_integers), "Format", "target", "");
    let dark = NearFieldEffect::obscurance(f32::NAN, Quality::Fast);
    let named = "ObscuranceSettings::radius";
    refused(
        new(NearFieldDescriptor::new(dark)),
        "Setting",
        named,
        "0 or more",
    );
    let nowhere = NearFieldDescriptor {
        masks: Some(MultiResMaskSettings {
            levels: [None; 4],
            ..MultiResMaskSettings::OCCLUSION
        }),
        ..NearFieldDescriptor::by_masks(obscurance, Format::R8Unorm)
    };
    refused(new(nowhere), "Setting", "MultiResMaskSettings::levels", "");

    let mut made = view(&NearFieldDescriptor::new(obscurance));
    refused(made.set_effect(dark), "Setting", named, "0 or more");
    let finer = NearFieldEffect::obscurance(0.5, Quality::Accurate);
    refused(
        made.set_effect(finer),
        "Mismatch",
        "NearFieldEffect",
        "descriptor",
    );
    made.set_effect(NearFieldEffect::obscurance(0.25, Quality::Fast))
        .expect("another radius");

    let target = gpu.target(Format::R8Unorm, 32, 24);
    let record = |view: &mut NearFieldView, input: &NearFieldInput<'_>| {
        view.record(device, &mut gpu.encoder(), input)
    };
    let gbuffer = stage.drawn.gbuffer();
    let input = NearFieldInput::new(gbuffer, &stage.camera, target.texture());
    let lit = NearFieldInput {
        source: stage.source(Effect::Indirect),
        ..input
    };
    refused(
        record(&mut made, &lit),
        "Mismatch",
        "NearFieldInput::source",
        "GBuffer",
    );
    let shadows = NearFieldEffect::SoftShadows(SoftShadowsSettings::default());
    let mut shadows = view(&NearFieldDescriptor::by_masks(shadows, Format::R8Unorm));
    let of_light = NearFieldInput {
        source: stage.source(Effect::Shadow),
        ..input
    };
    refused(
        record(&mut shadows, &input),
        "Mismatch",
        "NearFieldInput::source",
        "Light",
    );
    let of_floats = gpu.target(Format::R32Float, 32, 24);
    let other = NearFieldInput {
        target: of_floats.texture().into(),
        ..of_light
    };
    refused(
        record(&mut shadows, &other),
        "Mismatch",
        "NearFieldInput::target",
        "R8Unorm",
    );

    let viewport = Viewport {
        x: 4,
        y: 2,
        width: 24,
        height: 20,
    };
    let view_from_world =
        DMat4::from_mat3(stage.camera.rotation()) * DMat4::from_translation(-stage.camera.eye());
    let within =
        Camera::new(view_from_world, stage.camera.projection(), viewport).expect("a camera");
    let within = NearFieldInput {
        camera: &within,
        ..of_light
    };
    refused(
        record(&mut shadows, &within),
        "Mismatch",
        "NearFieldInput::camera",
        "0, 0",
    );
    let none = NearFieldSource::GBuffer;
    let nothing = NearFieldInput {
        source: none,
        ..of_light
    };
    refused(
        record(&mut shadows, &nothing),
        "Mismatch",
        "NearFieldInput::source",
        "Light",
    );
    let mut encoder = gpu.encoder();
    let recorded: Result<(), _> = shadows.record(device, &mut encoder, &of_light);
    recorded.expect("what the effect needs");
    let _: wgpu::CommandBuffer = encoder.finish();
}
