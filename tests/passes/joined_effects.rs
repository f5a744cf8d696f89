//! Effects of any number of channels, and two of them in one splat: the GPU against the f64 mirror, and against each alone.

use deep_screen_space::{
    AmbientOcclusion, DiffuseBounce, Effect, Error, Reconstructor, ReconstructorInput,
    ReconstructorSettings, SurfelRadiance, TextureSlice,
    glam::DVec3,
    reference::effects::{Both, Joined},
    scenes, shaders,
    wgpu::{TextureFormat as Format, TextureUsages},
};
use support::{
    gpu::Gpu,
    testing::{
        frames::Decoded,
        passes::texture,
        pipelines,
        refusals::refused,
        shot::{Shot, camera_of},
        splats::{Options, Passes, run, splat_settings},
    },
};

use super::splatted::lit;

fn bounce() -> (DiffuseBounce, Effect) {
    let bounce = DiffuseBounce {
        two_sided: true,
        unit: 2.0,
    };
    (bounce, bounce.effect().expect("a unit"))
}

/// A quarter are black, to be left out by the light alone.
fn options(levels: u32) -> Options {
    let sent = |i: u32, k: u32| {
        if i.is_multiple_of(4) {
            0.0
        } else {
            (i * k % 32) as f32 / 16.0
        }
    };
    let of = |i: u32| SurfelRadiance {
        front: [13, 5, 3].map(|k| sent(i, k)),
        back: [7, 11, 9].map(|k| sent(i, k)),
        ..SurfelRadiance::default()
    };
    lit(splat_settings(levels, 0.02), |count| {
        (0..count).map(of).collect()
    })
}

fn shot(gpu: &Gpu) -> Shot {
    let scene = scenes::dominoes();
    Shot::new(gpu, &scene, &camera_of(&scene, 0, [36, 28]))
}

fn albedo(shot: &Shot) -> Vec<DVec3> {
    let materials = scenes::dominoes().triangle_materials();
    let of = |triangle: usize| DVec3::from(materials[triangle].albedo.map(f64::from));
    let pixels = shot.pixels.iter();
    pixels
        .map(|p| p.map_or(DVec3::ZERO, |p| of(p.triangle)))
        .collect()
}

/// How far apart two pictures are at most, relative to 1 + their values.
fn apart(a: &[[f32; 4]], b: &[[f32; 4]]) -> f32 {
    let pairs = a.iter().flatten().zip(b.iter().flatten());
    pairs
        .map(|(a, b)| (a - b).abs() / (1.0 + b.abs()))
        .fold(0.0, |most, off| if off <= most { most } else { off })
}

#[test]
fn joined_effects_are_both() {
    let gpu = pipelines::gpu();
    let shot = shot(gpu);
    let occlusion = AmbientOcclusion {
        own_surface: true,
        ..AmbientOcclusion::default()
    };
    let (bounce, light) = bounce();
    let both = occlusion.effect().and(&light).expect("four channels");
    let options = options(3);
    let found = run(gpu, &shot, &Passes::new(&both, false), &options);
    let channels = |Both(open, light): Both<f64, DVec3>| vec![open, light.x, light.y, light.z];
    let mirror = Joined(occlusion, bounce);
    found.compare(gpu, (&mirror, &options), channels, "both");

    // The totals that the outputs are of.
    let both_of = |sum: &[f64]| Both(sum[0], DVec3::new(sum[1], sum[2], sum[3]));
    let totals = found.totals(gpu, (&shot, &options), 4, both_of);
    let pictures = found.pictures(gpu, &shot, &both, &options);
    let albedo = albedo(&shot);
    for (i, Both(open, sent)) in totals.into_iter().enumerate() {
        let open = occlusion.visibility(open);
        let sent = bounce.radiance(sent, albedo[i]);
        let found = [
            pictures[0][i][0],
            pictures[1][i][0],
            pictures[1][i][1],
            pictures[1][i][2],
        ];
        for (found, expected) in found.into_iter().zip([open, sent.x, sent.y, sent.z]) {
            // Of the reconstructor's own tests: rounding of plane distances.
            let off = (f64::from(found) - expected).abs();
            assert!(
                off < 1e-3 * (1.0 + expected),
                "pixel {i}: {found}, {expected}"
            );
        }
    }
}

/// On one level, where nothing is left to chance, an output is what its effect is by itself, in either order.
#[test]
fn outputs_are_those_of_each_alone() {
    let gpu = pipelines::gpu();
    let shot = shot(gpu);
    let occlusion = AmbientOcclusion {
        two_sided: true,
        ..AmbientOcclusion::default()
    };
    let (_, light) = bounce();
    let occlusion = occlusion.effect();
    let options = options(1);
    let alone = [&occlusion, &light].map(|effect| {
        let run = run(gpu, &shot, &Passes::new(effect, false), &options);
        run.pictures(gpu, &shot, effect, &options).remove(0)
    });
    // Twice the same with itself, too.
    let both = occlusion.and(&light).expect("four channels");
    let all = light.and(&both).expect("seven channels");
    for (effect, order) in [(&both, &[0, 1][..]), (&all, &[1, 0, 1])] {
        let run = run(gpu, &shot, &Passes::new(effect, false), &options);
        let pictures = run.pictures(gpu, &shot, effect, &options);
        assert_eq!(pictures.len(), order.len());
        for (picture, &which) in pictures.iter().zip(order) {
            // The order of sums is the same; products and sums may be fused otherwise.
            let off = apart(picture, &alone[which]);
            println!("{}: output {which} is {off:e} off", effect.label);
            assert!(off < 1e-5, "{}: output {which} is {off} off", effect.label);
        }
    }
}

/// Channel c is c + 1 times the first: in the level sums, and smoothed. Each output adds up some of them.
#[test]
fn all_channels_are_summed_alike() {
    let gpu = pipelines::gpu();
    let shot = shot(gpu);
    for channels in [2, 4, 7] {
        let sum = match channels {
            2 => "vec2f(1.0, 2.0)",
            4 => "vec4f(1.0, 2.0, 3.0, 4.0)",
            _ => "mat2x4f(1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 0.0)",
        };
        let shown = match channels {
            2 => "sum.x, sum.y, 0.0, 0.0",
            4 => "sum",
            _ => "sum[0]",
        };
        let high = if channels > 4 { "sum[1]" } else { "0.0" };
        let base = AmbientOcclusion::default().effect();
        let (kept, _) = base
            .source
            .split_once("fn own_surface")
            .expect("its third function");
        let source = format!(
            "{}
fn contribution(sender: Sender, receiver_normal: vec3f, to_sender: vec3f, distance2: f32) -> Sum {{
  return {sum} * factor(sender, receiver_normal, to_sender, distance2);
}}
fn low(sum: Sum, albedo: vec3f) -> vec4f {{ return vec4f({shown}); }}
fn high(sum: Sum, albedo: vec3f) -> vec4f {{ return vec4f({high}); }}
",
            kept.replace("fn contribution", "fn factor")
        );
        let effect = Effect {
            channels,
            outputs: vec!["low".into(), "high".into()],
            constants: base.constants.clone(),
            ..Effect::new(format!("{channels} channels"), source)
        };
        let options = options(3);
        let run = run(gpu, &shot, &Passes::new(&effect, false), &options);
        for level in 0..3 {
            let found = run.channels(gpu, level, channels as usize);
            assert!(
                level > 0 || found[0].iter().any(|v| *v > 0.05),
                "{channels}: all dark"
            );
            for (c, sums) in (1_u8..).zip(&found) {
                for (sum, first) in sums.iter().zip(&found[0]) {
                    let expected = f32::from(c) * first;
                    // Sums of thousands of terms, each with a rounding of its own.
                    assert!(
                        (sum - expected).abs() <= 1e-5 * expected,
                        "{channels}, channel {c}"
                    );
                }
            }
        }
        let [low, high] = &run.pictures(gpu, &shot, &effect, &options)[..] else {
            panic!("two outputs");
        };
        for (low, high) in low.iter().zip(high) {
            let all = [*low, *high].concat();
            for c in 0..channels as usize {
                let expected = (c + 1) as f32 * all[0];
                assert!(
                    (all[c] - expected).abs() <= 1e-4 * expected.abs(),
                    "{channels}: {all:?}"
                );
            }
            assert!(
                all[channels as usize..].iter().all(|v| *v == 0.0),
                "{all:?}"
            );
        }
    }
}

/// What a module binds, by its numbers.
fn bindings(effect: &Effect, name: &str) -> Vec<u32> {
    let all = shaders(effect).expect("well-formed directives");
    let module = all.iter().find(|m| m.name == name).expect("a module");
    let numbers = module.source.split("@binding(").skip(1);
    let mut numbers: Vec<u32> = numbers
        .map(|text| {
            text.split(')')
                .next()
                .unwrap_or_default()
                .parse()
                .expect("a number")
        })
        .collect();
    numbers.sort_unstable();
    numbers
}

/// Occlusion alone binds and keeps what it did before there were other effects: an f32 a pixel and level, and nothing for light.
#[test]
fn occlusion_alone_costs_nothing_more() {
    let gpu = pipelines::gpu();
    let effect = AmbientOcclusion::default().effect();
    assert_eq!(
        bindings(&effect, "shell_splatter build"),
        [0, 1, 2, 3, 4, 9]
    );
    assert_eq!(
        bindings(&effect, "shell_splatter splat"),
        [0, 1, 2, 3, 4, 5, 6]
    );
    assert_eq!(bindings(&effect, "reconstructor smooth"), [0, 1, 2, 3]);
    assert_eq!(bindings(&effect, "reconstructor smoothed"), [0, 1, 2, 3]);
    assert_eq!(bindings(&effect, "reconstructor"), [0, 1, 2]);
    let (_, light) = bounce();
    let both = effect.and(&light).expect("four channels");
    let more = [0, 1, 2, 3, 4, 5, 6, 10];
    assert_eq!(bindings(&both, "shell_splatter splat"), more);
    for (effect, pixel) in [(&effect, 4), (&light, 16), (&both, 16)] {
        let device = &gpu.device;
        let splatter = pipelines::shell_splatter(effect, false);
        let view = splatter.create_view(device, 40, 30, 5).expect("a view");
        let layers = view.sums().texture().depth_or_array_layers();
        assert_eq!((view.memory_bytes(), layers), (5 * pixel * 40 * 30, 5));
        let reconstructor = pipelines::reconstructor(effect, Format::Rgba32Float);
        let scratch = reconstructor.create_view(device, &view).expect("a view");
        assert_eq!(scratch.memory_bytes(), 5 * pixel * 40 * 30);
    }
}

#[test]
fn other_numbers_of_channels_and_targets_are_refused() {
    let gpu = pipelines::gpu();
    let device = &gpu.device;
    let occlusion = AmbientOcclusion::default().effect();
    for channels in [0, 9] {
        let effect = Effect {
            channels,
            ..occlusion.clone()
        };
        let made = Reconstructor::new(device, &effect, Format::R32Float);
        refused(made, "Setting", "Effect::channels", "1 to 8");
    }
    let no_output = Effect {
        outputs: vec!["shown".into()],
        ..occlusion.clone()
    };
    let made = Reconstructor::new(device, &no_output, Format::R32Float);
    refused(made, "Effect", "shown", "output");
    let both = occlusion.and(&occlusion).expect("two channels");
    let made = Reconstructor::with_targets(device, &both, &[Format::R32Float]);
    refused(made, "Mismatch", "Reconstructor targets", "needed is 2");

    let shot = shot(gpu);
    let run = run(gpu, &shot, &Passes::new(&both, false), &options(1));
    let reconstructor = pipelines::reconstructor(&both, Format::R32Float);
    let scratch = reconstructor
        .create_view(device, &run.view)
        .expect("a view");
    let mut encoder = gpu.encoder();
    let mut decoded = Decoded::of(&shot.camera);
    let frame = decoded.frame(&mut encoder, shot.gbuffer(), &shot.camera, run.origin);
    let [one, other] = [(); 2].map(|()| {
        texture(
            gpu,
            Format::R32Float,
            run.view.size(),
            TextureUsages::RENDER_ATTACHMENT,
        )
    });
    let mut record = |further: &[&_]| {
        let further: Vec<TextureSlice<'_>> =
            further.iter().map(|&t| TextureSlice::new(t)).collect();
        let input = ReconstructorInput {
            further: &further,
            ..ReconstructorInput::new(&frame, &run.view, &one)
        };
        let settings = ReconstructorSettings::default();
        reconstructor.record(device, &mut encoder, &input, &settings, &scratch)
    };
    refused(record(&[]), "Mismatch", "ReconstructorInput", "needed is 2");
    refused(
        record(&[&other, &other]),
        "Mismatch",
        "ReconstructorInput",
        "needed is 2",
    );
    refused(
        record(&[&one]),
        "Mismatch",
        "ReconstructorInput::target",
        "of its own",
    );
    assert_eq!(record(&[&other]), Ok::<(), Error>(()));
}
