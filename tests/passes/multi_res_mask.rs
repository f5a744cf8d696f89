//! The `MultiResMask`: GPU against the f64 mirror, and what must hold of any mask.

use deep_screen_space::{
    Error, MultiResLevel, MultiResMaskSettings, MultiResView, Viewport,
    glam::{DMat4, DVec3, dcamera::rh::proj::directx as right},
    reference::multi_res_mask::{self as mirror, coarsen},
    scenes,
    wgpu::TextureFormat as Format,
};
use support::testing::multi_res::{Frame, camera, framed, random, read_list, read_mask, record};
use support::testing::pipelines;
use support::{gpu::Gpu, multires::read_blocks};

const PRESETS: [MultiResMaskSettings; 3] = [
    MultiResMaskSettings::OCCLUSION,
    MultiResMaskSettings::SHADOW,
    MultiResMaskSettings::INDIRECT,
];

fn size_of([width, height]: [u32; 2], level: u32) -> [u32; 2] {
    [width, height].map(|n| n.div_ceil(1 << level))
}

/// What holds of every recording: lists are what the masks say, in order; dispatches and stencils are theirs; the coarsest
/// level has everything and each level what the finer ones have. Gives the number of listed pixels a level.
fn check(
    gpu: &Gpu,
    view: &MultiResView,
    settings: &MultiResMaskSettings,
    name: &str,
) -> [usize; 4] {
    let mut counts = [0; 4];
    let mut finer: Option<(u32, Vec<f64>)> = None;
    for level in 0..4 {
        if settings.levels[level as usize].is_none() {
            assert!(view.work(level).is_none(), "{name}: level {level}");
            continue;
        }
        let [width, height] = size_of(view.size(), level);
        let mask = read_mask(gpu, view, level);
        assert!(
            mask.iter().all(|m| (0.0..=1.0).contains(m)),
            "{name}: level {level}"
        );
        let list = read_list(gpu, view, level);
        let expected = mirror::list(&mask, width, settings, level);
        assert_eq!(list, expected, "{name}: level {level}");
        let dispatch: Vec<u32> = gpu.read_buffer(view.work(level).expect("a level").dispatch);
        let groups = list.len().div_ceil(64) as u32;
        assert_eq!(
            dispatch[..3],
            [groups.min(32768), groups.div_ceil(32768), 1],
            "{name}: level {level}"
        );
        let stencil: Vec<u8> = gpu.read_texture(view.stencil(level).expect("one").texture(), 0);
        for (i, (&m, &s)) in mask.iter().zip(&stencil).enumerate() {
            assert_eq!(u8::from(m > 0.0), s, "{name}: level {level}, pixel {i}");
        }
        let mask: Vec<f64> = mask.into_iter().map(f64::from).collect();
        if let Some((finer_level, finer)) = finer {
            let inside = coarsen(
                &finer,
                size_of(view.size(), finer_level),
                level - finer_level,
            );
            for (i, (own, inside)) in mask.iter().zip(inside).enumerate() {
                assert!(*own >= inside, "{name}: level {level}, pixel {i}");
            }
        }
        counts[level as usize] = list.len();
        finer = Some((level, mask));
        if settings.levels[level as usize + 1..]
            .iter()
            .all(Option::is_none)
        {
            assert_eq!(list.len() as u32, width * height, "{name}: the coarsest");
        }
    }
    counts
}

/// A view's edges and masks against the mirror. A value may be one of 255 steps off, where both round the other way. Of the
/// edges 0.1 % and of the masks' values 0.2 % may differ by more: f32 rounds depths and normals by some 1e-6 of what a
/// threshold of 0.01 divides, and a kernel spreads one such edge over dozens of pixels.
fn compare(gpu: &Gpu, frame: &Frame, view: &MultiResView, edges: &mirror::Edges<'_>, name: &str) {
    let expected = edges.find();
    let found = read_blocks(gpu, view.edges().expect("edges"), view.size());
    let off = |a: f32, b: f64| (f64::from(a) - b).abs() > 1.5 / 255.0;
    let count = |found: &[f32], expected: &[f64]| {
        found
            .iter()
            .zip(expected)
            .filter(|(f, e)| off(**f, **e))
            .count()
    };
    let differ = count(&found, &expected);
    assert!(
        differ <= found.len() / 1000,
        "{name}: {differ} of {} edges differ",
        found.len()
    );
    let masks = mirror::masks(&expected, frame.size(), edges.settings);
    for level in 0..4 {
        let Some(expected) = &masks[level as usize] else {
            continue;
        };
        let found = read_mask(gpu, view, level);
        let differ = count(&found, expected);
        assert!(
            differ <= found.len() / 500,
            "{name}, level {level}: {differ} of {} differ",
            found.len()
        );
    }
}

fn edges<'a>(frame: &'a Frame, settings: &'a MultiResMaskSettings) -> mirror::Edges<'a> {
    mirror::Edges {
        decoder: frame.decoder(),
        depth: &frame.depth,
        normal: &frame.normal,
        shading: None,
        extra: None,
        importance: None,
        settings,
    }
}

#[test]
fn gpu_is_its_mirror() {
    let gpu = pipelines::gpu();
    let pass = pipelines::multi_res_mask();
    for (name, size) in [
        ("cornell", [96, 64]),
        ("dominoes", [101, 67]),
        ("colonnade", [93, 61]),
    ] {
        let scene = scenes::by_name(name).expect("a scene");
        let frame = Frame::of_scene(gpu, &scene, size);
        for settings in &PRESETS {
            let view = record(gpu, pass, &frame.input(), settings);
            let counts = check(gpu, &view, settings, name);
            println!("{name}: {counts:?}");
            compare(gpu, &frame, &view, &edges(&frame, settings), name);
            // Some of it is near edges and some is not.
            let share = counts[0] as f64 / f64::from(size[0] * size[1]);
            assert!((0.02..0.98).contains(&share), "{name}: {share}");
        }
    }
}

fn wall(slope: [f64; 2]) -> impl Fn([u32; 2], DVec3, DVec3) -> Option<(DVec3, DVec3)> {
    let normal = DVec3::new(slope[0], slope[1], 1.0).normalize();
    move |_, from, along| {
        let t = (DVec3::new(0.0, 0.0, -5.0) - from).dot(normal) / along.dot(normal);
        (t > 0.0).then(|| (from + t * along, normal))
    }
}

fn projections() -> [(&'static str, DMat4); 5] {
    [
        (
            "reversed, infinite",
            right::perspective_infinite_reverse(1.0, 1.4, 0.1),
        ),
        ("reversed", right::perspective(1.0, 1.4, 100.0, 0.1)),
        ("forward", right::perspective(1.0, 1.4, 0.1, 100.0)),
        (
            "orthographic",
            right::orthographic(-4.0, 4.0, -3.0, 3.0, 0.1, 100.0),
        ),
        (
            "reversed orthographic",
            right::orthographic(-4.0, 4.0, -3.0, 3.0, 100.0, 0.1),
        ),
    ]
}

/// A plane at any angle has no edges, in any projection and depth format; a step in it has.
#[test]
fn planes_have_no_edges_and_steps_have() {
    let gpu = pipelines::gpu();
    let pass = pipelines::multi_res_mask();
    let settings = MultiResMaskSettings::OCCLUSION;
    let viewport = Viewport {
        x: 3,
        y: 5,
        width: 77,
        height: 45,
    };
    for (name, projection) in projections() {
        let camera = camera(projection, viewport);
        for format in [Format::R32Float, Format::Depth16Unorm] {
            for slope in [[0.0, 0.0], [0.8, 0.0], [-0.3, 1.1]] {
                let name = format!("{name}, {format:?}, {slope:?}");
                let see = wall(slope);
                let flat = Frame::cast(gpu, &camera, format, &see);
                let view = record(gpu, pass, &flat.input(), &settings);
                let counts = check(gpu, &view, &settings, &name);
                assert_eq!(counts[..3], [0, 0, 0], "{name}");
                // Half of it a fifth nearer.
                let stepped = Frame::cast(gpu, &camera, format, |pixel, from, along| {
                    let seen = see(pixel, from, along);
                    if pixel[0] < 40 {
                        return seen;
                    }
                    seen.map(|(p, n)| (from + 0.8 * (p - from), n))
                });
                let view = record(gpu, pass, &stepped.input(), &settings);
                let counts = check(gpu, &view, &settings, &name);
                // Two columns, and the kernel's two on each side.
                assert_eq!(counts[0], 6 * 45, "{name}");
                compare(gpu, &stepped, &view, &edges(&stepped, &settings), &name);
            }
        }
    }
}

/// No edges but those of the sky, all edges, one pixel, and images of any size.
#[test]
fn extremes() {
    let gpu = pipelines::gpu();
    let pass = pipelines::multi_res_mask();
    let projection = right::perspective_infinite_reverse(1.0, 1.4, 0.1);
    for size in [[1, 1], [1, 9], [7, 5], [8, 8], [9, 8], [17, 31], [65, 33]] {
        let [width, height] = size;
        let camera = camera(projection, Viewport::full(width, height));
        let pixels = (width * height) as usize;
        for settings in &PRESETS {
            let listed = |frame: &Frame, what: &str| {
                let view = record(gpu, pass, &frame.input(), settings);
                let name = format!("{what}, {size:?}");
                let counts = check(gpu, &view, settings, &name);
                compare(gpu, frame, &view, &edges(frame, settings), &name);
                counts
            };
            let sky = Frame::cast(gpu, &camera, Format::R32Float, |_, _, _| None);
            assert_eq!(listed(&sky, "sky")[..3], [0; 3], "{size:?}");
            let noise = Frame::cast(gpu, &camera, Format::R32Float, |[x, y], from, along| {
                let (p, _) = wall([0.0; 2])([x, y], from, along)?;
                let i = y * width + x;
                let n = DVec3::from([0, 1, 2].map(|k| random(i, k) - 0.5));
                Some((p, n.normalize()))
            });
            let counts = listed(&noise, "noise");
            if pixels > 1 {
                assert_eq!(counts[0], pixels, "{size:?}");
            }
            // A pole one pixel wide, before the sky.
            let pole = Frame::cast(gpu, &camera, Format::R32Float, |[x, y], from, along| {
                let here = [x, y] == [width / 2, height / 2];
                wall([0.0; 2])([x, y], from, along).filter(|_| here)
            });
            let counts = listed(&pole, "one pixel");
            if pixels > 1 {
                assert!(
                    counts[0] > 0 && counts[0] <= 49.min(pixels),
                    "{size:?}: {counts:?}"
                );
            }
        }
    }
}

/// What is not finite is an edge, and not more.
#[test]
fn garbage_is_an_edge() {
    let gpu = pipelines::gpu();
    let pass = pipelines::multi_res_mask();
    let camera = camera(
        right::perspective_infinite_reverse(1.0, 1.4, 0.1),
        Viewport::full(64, 48),
    );
    let flat = Frame::cast(gpu, &camera, Format::R32Float, wall([0.2, 0.1]));
    for (bad, value) in [f64::NAN, f64::INFINITY, -1.0].into_iter().enumerate() {
        let mut depth = flat.depth.clone();
        depth[20 * 64 + 30] = value;
        let mut normal = flat.normal.clone();
        normal[30 * 64 + 11] = DVec3::new(value, f64::NAN, 0.0);
        let frame = Frame::new(gpu, &camera, Format::R32Float, depth, &normal);
        let settings = MultiResMaskSettings::OCCLUSION;
        let view = record(gpu, pass, &frame.input(), &settings);
        let counts = check(gpu, &view, &settings, &format!("garbage {bad}"));
        assert!((20..=120).contains(&counts[0]), "{value}: {counts:?}");
    }
}

/// The caller's own edges are maxima, importance is a minimum over all, and shading is differentiated.
#[test]
fn sources_of_the_caller() {
    let gpu = pipelines::gpu();
    let pass = pipelines::multi_res_mask();
    let settings = MultiResMaskSettings::SHADOW;
    let viewport = Viewport {
        x: 2,
        y: 1,
        width: 83,
        height: 50,
    };
    let camera = camera(right::perspective_infinite_reverse(1.0, 1.6, 0.1), viewport);
    // A step at column 30; the caller's edges at column 60, shading differs at row 20, and the right fifth is unimportant.
    let frame = Frame::cast(gpu, &camera, Format::R32Float, |pixel, from, along| {
        let (p, n) = wall([0.0; 2])(pixel, from, along)?;
        Some((p * if pixel[0] < 30 { 1.0 } else { 0.8 }, n))
    });
    let image = |value: &dyn Fn([u32; 2]) -> f32| -> Vec<f32> {
        (0..83 * 50).map(|i| value([i % 83, i / 83])).collect()
    };
    let own = image(&|[x, _]| f32::from(u8::from(x == 60)) * 0.75);
    let shading = image(&|[_, y]| if y < 20 { 0.2 } else { 0.9 });
    let importance = image(&|[x, _]| if x < 66 { 1.0 } else { 0.0 });
    let views = [&shading, &own, &importance]
        .map(|texels| framed(gpu, &camera, Format::R32Float, texels, f32::NAN));
    let wide = [&shading, &own, &importance]
        .map(|t| t.iter().map(|&v| f64::from(v)).collect::<Vec<f64>>());
    for chosen in 0..8_u32 {
        let given = |bit: u32| (chosen & 1 << bit) != 0;
        let name = format!("sources {chosen:03b}");
        let mut input = frame.input();
        input.shading = given(0).then_some(views[0].texture().into());
        input.edges = given(1).then_some(views[1].texture().into());
        input.importance = given(2).then_some(views[2].texture().into());
        let view = record(gpu, pass, &input, &settings);
        check(gpu, &view, &settings, &name);
        let mut expected = edges(&frame, &settings);
        expected.shading = given(0).then_some(&wide[0]);
        expected.extra = given(1).then_some(&wide[1]);
        expected.importance = given(2).then_some(&wide[2]);
        compare(gpu, &frame, &view, &expected, &name);
        let mask = read_mask(gpu, &view, 0);
        let at = |x: u32, y: u32| mask[(y * 83 + x) as usize];
        assert!(at(30, 40) > 0.0, "{name}");
        assert_eq!(at(60, 40) > 0.0, given(1), "{name}");
        assert_eq!(at(10, 20) > 0.0, given(0), "{name}");
        assert_eq!(at(80, 20) > 0.0, given(0) && !given(2), "{name}");
    }
    // Everything, and nothing.
    let full = framed(gpu, &camera, Format::R32Float, &image(&|_| 1.0), 0.0);
    let none = framed(gpu, &camera, Format::R32Float, &image(&|_| 0.0), 1.0);
    let mut input = frame.input();
    input.edges = Some(full.texture().into());
    let view = record(gpu, pass, &input, &settings);
    assert_eq!(check(gpu, &view, &settings, "full")[0], 83 * 50);
    input.importance = Some(none.texture().into());
    let view = record(gpu, pass, &input, &settings);
    assert_eq!(check(gpu, &view, &settings, "none")[..3], [0; 3]);
}

/// Any of the levels may be left out, and thresholds list less.
#[test]
fn levels_and_thresholds() {
    let gpu = pipelines::gpu();
    let pass = pipelines::multi_res_mask();
    let scene = scenes::cornell();
    let frame = Frame::of_scene(gpu, &scene, [75, 50]);
    for chosen in 1..16_u32 {
        let all = MultiResMaskSettings::OCCLUSION.levels;
        let mut settings = MultiResMaskSettings::OCCLUSION;
        for (level, own) in settings.levels.iter_mut().enumerate() {
            *own = all[level].filter(|_| chosen & 1 << level != 0);
        }
        let name = format!("levels {chosen:04b}");
        let view = record(gpu, pass, &frame.input(), &settings);
        check(gpu, &view, &settings, &name);
        compare(gpu, &frame, &view, &edges(&frame, &settings), &name);
    }
    let mut before = usize::MAX;
    for threshold in [0.0, 0.1, 0.5, 1.0] {
        let level = |variance| {
            Some(MultiResLevel {
                threshold,
                ..MultiResLevel::new(variance, 10.0)
            })
        };
        let settings =
            MultiResMaskSettings::with_levels([level(0.9), level(4.0), level(16.0), level(0.0)]);
        let name = format!("threshold {threshold}");
        let view = record(gpu, pass, &frame.input(), &settings);
        let counts = check(gpu, &view, &settings, &name);
        compare(gpu, &frame, &view, &edges(&frame, &settings), &name);
        assert!(counts[0] < before, "{name}: {counts:?}");
        before = counts[0];
    }
    assert_eq!(before, 0);
}

/// The same bits each time.
#[test]
fn recordings_repeat() {
    let gpu = pipelines::gpu();
    let pass = pipelines::multi_res_mask();
    let frame = Frame::of_scene(gpu, &scenes::dominoes(), [64, 40]);
    let settings = MultiResMaskSettings::OCCLUSION;
    let [first, second] = [(); 2].map(|()| {
        let view = record(gpu, pass, &frame.input(), &settings);
        (0..4)
            .map(|l| (read_mask(gpu, &view, l), read_list(gpu, &view, l)))
            .collect::<Vec<_>>()
    });
    assert_eq!(first, second);
}

#[test]
fn what_cannot_be_is_refused() {
    let gpu = pipelines::gpu();
    let device = &gpu.device;
    let pass = pipelines::multi_res_mask();
    let camera = camera(
        right::perspective_infinite_reverse(1.0, 1.4, 0.1),
        Viewport::full(16, 8),
    );
    let frame = Frame::cast(gpu, &camera, Format::R32Float, wall([0.0; 2]));
    let good = MultiResMaskSettings::OCCLUSION;
    let level = |variance, weight, threshold| MultiResMaskSettings {
        levels: [
            Some(MultiResLevel {
                variance,
                weight,
                threshold,
            }),
            None,
            None,
            None,
        ],
        ..good
    };
    for (field, settings) in [
        (
            "levels",
            MultiResMaskSettings {
                levels: [None; 4],
                ..good
            },
        ),
        ("variance", level(-1.0, 1.0, 0.0)),
        ("variance", level(16.5, 1.0, 0.0)),
        ("weight", level(1.0, f32::NAN, 0.0)),
        ("threshold", level(1.0, 1.0, 1.5)),
        (
            "normal_threshold",
            MultiResMaskSettings {
                normal_threshold: 0.0,
                ..good
            },
        ),
        (
            "depth_threshold",
            MultiResMaskSettings {
                depth_threshold: f32::NAN,
                ..good
            },
        ),
        (
            "shading_threshold",
            MultiResMaskSettings {
                shading_threshold: -1.0,
                ..good
            },
        ),
    ] {
        let refused = settings.validate();
        assert!(
            matches!(&refused, Err(Error::Setting { field: f, .. }) if f.ends_with(field)),
            "{field}: {refused:?}"
        );
    }
    let refused = |view: &mut MultiResView, input| {
        let mut encoder = gpu.encoder();
        pass.record(device, &mut encoder, &input, &good, view)
    };
    let mut small = pass.create_view(device, 15, 8, false).expect("a view");
    assert!(small.work(0).is_none(), "not recorded yet");
    let other = refused(&mut small, frame.input());
    assert!(
        matches!(
            other,
            Err(Error::Mismatch {
                name: "MultiResView",
                ..
            })
        ),
        "{other:?}"
    );
    let mut fits = pass.create_view(device, 16, 8, false).expect("a view");
    let narrow = gpu.texture(Format::R32Float, 15, 8, &[0.0_f32; 120]);
    let mut input = frame.input();
    input.importance = Some(narrow.texture().into());
    let other = refused(&mut fits, input);
    assert!(
        matches!(
            other,
            Err(Error::Size {
                name: "MultiResMaskInput::importance",
                ..
            })
        ),
        "{other:?}"
    );
    let integers = gpu.texture(Format::R32Uint, 16, 8, &[0_u32; 128]);
    let mut input = frame.input();
    input.edges = Some(integers.texture().into());
    let other = refused(&mut fits, input);
    assert!(
        matches!(
            other,
            Err(Error::Format {
                name: "MultiResMaskInput::edges",
                ..
            })
        ),
        "{other:?}"
    );
    assert!(fits.stencil(0).is_none());
    let empty = pass.create_view(device, 0, 8, false);
    assert!(matches!(empty, Err(Error::Setting { .. })), "{empty:?}");
    let limit = device.limits().max_texture_dimension_2d;
    let large = pass.create_view(device, limit + 1, 8, false);
    assert!(matches!(large, Err(Error::Limit { .. })), "{large:?}");
}
