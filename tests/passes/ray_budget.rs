//! Rays where they matter: the `RayBudget` and further rays against their mirrors, that means stay what they are, and pixels
//! that have no rays at all.

use crate::hit_resolver::{errors, own, rms, shot_of, truth};
use deep_screen_space::{
    BouncedDescriptor, BouncedInput, BouncedSettings, BouncedView, BouncedZBuffer,
    HitEstimateInput, HitRadiance, HitResolver, HitResolverDescriptor, HitResolverInput,
    HitResolverSettings, MultiResLevel, MultiResMask, MultiResMaskInput, MultiResMaskSettings,
    Payload, PixelList, RayBudget, RayBudgetInput, RayBudgetSettings, Sampling, Viewport,
    glam::DVec3,
    reference::{
        bounced_z_buffer::{PixelRays, Tracing, nearest},
        hit_resolver::HitResolution,
        packing::unpack_color,
        ray_budget::Budget,
    },
    scenes, wgpu,
};
use support::testing::{
    frames::Decoded,
    pipelines,
    rays::{AMPLE, Senders, lab, triangles},
    refusals::{fields_refused, refused},
    shot::Shot,
};

fn counted(payload: Payload) -> BouncedDescriptor {
    BouncedDescriptor {
        payload,
        counted: true,
        ..BouncedDescriptor::default()
    }
}

fn tracer(payload: Payload) -> &'static BouncedZBuffer {
    pipelines::bounced(&counted(payload))
}

fn resolver(payload: Payload) -> &'static HitResolver {
    pipelines::hit_resolver(&HitResolverDescriptor {
        payload,
        sampling: Sampling::Cosine,
        deferred: false,
        counted: true,
        joined: false,
        bent_normals: false,
        emitter_samples: 0,
        target: wgpu::TextureFormat::Rgba32Float,
    })
}

fn budget() -> &'static RayBudget {
    pipelines::once(&(), |gpu| RayBudget::new(&gpu.device).expect("pipelines"))
}

fn rays(rays_per_pixel: u32) -> BouncedSettings {
    BouncedSettings {
        rays_per_pixel,
        sky_radiance: [0.5, 1.0, 2.0],
        ..BouncedSettings::default()
    }
}

fn further(rays_per_pixel: f32) -> RayBudgetSettings {
    RayBudgetSettings {
        rays_per_pixel,
        ..RayBudgetSettings::default()
    }
}

/// How a picture comes about.
#[derive(Clone, Copy)]
struct Plan<'a> {
    payload: Payload,
    traced: BouncedSettings,
    filter: HitResolverSettings,
    further: Option<RayBudgetSettings>,
    pixels: Option<&'a [PixelList<'a>]>,
    radiance: Option<&'a wgpu::Buffer>,
}

impl Plan<'_> {
    fn new(payload: Payload, traced: BouncedSettings) -> Self {
        Self {
            payload,
            traced,
            filter: HitResolverSettings::default(),
            further: None,
            pixels: None,
            radiance: None,
        }
    }
}

/// What came of it.
struct Taken {
    view: BouncedView,
    /// Before further rays.
    nearness: Vec<u32>,
    counts: Vec<PixelRays>,
    /// Pixels and sets, as they are listed.
    listed: Vec<[u32; 2]>,
    picture: Vec<[f32; 4]>,
}

impl Taken {
    fn rays(&self) -> u32 {
        self.counts.iter().map(|c| c.rays).sum()
    }
}

fn take(shot: &Shot, senders: &Senders, plan: &Plan<'_>) -> Taken {
    let lab = lab();
    let device = &lab.gpu.device;
    let Viewport { width, height, .. } = shot.camera.viewport();
    let (tracer, resolver) = (tracer(plan.payload), resolver(plan.payload));
    let view = tracer
        .create_view(device, width, height, plan.traced.rays_per_pixel)
        .expect("a view");
    let scratch = resolver.create_view(device, &view).expect("a view");
    let room = budget().create_view(device, width, height).expect("a view");
    let target = lab
        .gpu
        .target(wgpu::TextureFormat::Rgba32Float, width, height);
    let mut decoded = Decoded::of(&shot.camera);
    let mut encoder = lab.gpu.encoder();
    let origin = senders.cloud.origin();
    let frame = decoded.frame(&mut encoder, shot.lit_gbuffer(), &shot.camera, origin);
    let input = BouncedInput {
        radiance: plan
            .radiance
            .map_or(HitRadiance::None, HitRadiance::Surfels),
        pixels: plan.pixels,
        ..BouncedInput::new(&frame, &senders.cloud, &senders.bounds)
    };
    tracer
        .record(device, &mut encoder, &input, &plan.traced, &view)
        .expect("hits");
    lab.gpu.finish(encoder);
    let nearness = lab.gpu.read_buffer(view.nearness());
    let mut encoder = lab.gpu.encoder();
    if let Some(settings) = &plan.further {
        resolver
            .estimate(
                device,
                &mut encoder,
                &HitEstimateInput::new(&frame, &view),
                &plan.filter,
                &scratch,
            )
            .expect("means");
        let wanted = RayBudgetInput::new(&frame, &view, &scratch, &plan.filter);
        budget()
            .record(device, &mut encoder, &wanted, settings, &room)
            .expect("a budget");
        tracer
            .record_more(device, &mut encoder, &input, &plan.traced, (&view, &room))
            .expect("further rays");
    }
    let resolved = HitResolverInput::new(&frame, &view, target.texture());
    resolver
        .record(device, &mut encoder, &resolved, &plan.filter, &scratch)
        .expect("a picture");
    lab.gpu.finish(encoder);
    let counts = view.counts().expect("counted");
    let counts = if plan.payload == Payload::Occlusion {
        let words: Vec<[u32; 2]> = lab.gpu.read_buffer(counts);
        let of = |[blocked, rays]: [u32; 2]| PixelRays {
            sum: DVec3::splat(
                f64::from(rays.saturating_sub(plan.traced.rays_per_pixel)) - f64::from(blocked),
            ),
            rays,
        };
        words.into_iter().map(of).collect()
    } else {
        let words: Vec<[f32; 4]> = lab.gpu.read_buffer(counts);
        let of = |[r, g, b, rays]: [f32; 4]| PixelRays {
            sum: DVec3::new(r.into(), g.into(), b.into()),
            rays: rays.to_bits(),
        };
        words.into_iter().map(of).collect()
    };
    let pairs: Vec<[u32; 2]> = lab.gpu.read_buffer(room.pixels());
    let listed = if plan.further.is_some() {
        pairs[1..=pairs[0][0] as usize].to_vec()
    } else {
        Vec::new()
    };
    Taken {
        nearness,
        counts,
        listed,
        picture: lab.gpu.read_texture(target.texture(), 0),
        view,
    }
}

fn room_shot() -> (Shot, Senders) {
    let shot = shot_of(&scenes::closed_room(), 0, [45, 34]);
    let senders = lab().senders(&shot.buffers.meshes(), &shot.camera, &triangles(), AMPLE);
    (shot, senders)
}

/// What came along the first set's rays.
fn incoming(taken: &Taken, plan: &Plan<'_>) -> Vec<DVec3> {
    let n = plan.traced.rays_per_pixel as usize;
    if plan.payload == Payload::Occlusion {
        let words = lab().blocked(&taken.view, &plan.traced);
        let open =
            |pixel: usize, i: usize| 1 - ((words[pixel * n.div_ceil(32) + i / 32] >> (i % 32)) & 1);
        (0..taken.counts.len() * n)
            .map(|i| DVec3::splat(f64::from(open(i / n, i % n))))
            .collect()
    } else {
        let colors = lab().colors(&taken.view, &plan.traced);
        colors.into_iter().map(unpack_color).collect()
    }
}

/// Which pixels get how many sets is the mirror's choice, but where a need is rounded to another side of a whole number of sets:
/// the needs differ by 1e-4 at most, and few pixels in a hundred lie that near to one. What the sets bring is what the mirror's
/// rays meet, but where a ray passes an edge within f32's rounding; and the picture is made of both as the mirror makes it.
#[test]
fn further_rays_are_the_mirrors() {
    let (shot, senders) = room_shot();
    let receivers = shot.receivers(senders.cloud.origin());
    let settings = further(3.0);
    let mut plan = Plan {
        further: Some(settings),
        ..Plan::new(Payload::Occlusion, rays(4))
    };
    plan.traced.radius = 1.5;
    // The variance is in the picture then.
    plan.filter.variance_clamp = 3.0;
    let taken = take(&shot, &senders, &plan);
    let first = incoming(&taken, &plan);
    let mut mirror = HitResolution {
        camera: &shot.camera,
        origin: senders.cloud.origin(),
        receivers: &receivers,
        traced: &plan.traced,
        payload: plan.payload,
        sampling: Sampling::Cosine,
        settings: &plan.filter,
        deferred: false,
        incoming: &first,
        nearness: &taken.nearness,
        counts: None,
        joined: None,
    };
    let (means, near) = (mirror.average(), mirror.near());
    let choice = Budget {
        hits: &mirror,
        means: &means,
        near: &near,
        settings: &settings,
        roughness: None,
    };
    let needs: Vec<f32> = choice.needs().into_iter().map(|need| need as f32).collect();
    let expected = choice.sets(&needs, choice.scale(&needs));
    let width = shot.camera.viewport().width;
    let mut found = vec![0; expected.len()];
    for [pixel, sets] in &taken.listed {
        found[((pixel >> 16) * width + (pixel & 0xffff)) as usize] = *sets;
    }
    let off = found.iter().zip(&expected).filter(|(a, b)| a != b).count();
    let most = found
        .iter()
        .zip(&expected)
        .map(|(a, b)| a.abs_diff(*b))
        .max();
    println!(
        "{off} of {} pixels have another number of sets",
        found.len()
    );
    assert!(
        off * 100 <= found.len() && most <= Some(1),
        "{off}, {most:?}"
    );

    let tracing = Tracing {
        receivers: &receivers,
        camera: &shot.camera,
        origin: senders.cloud.origin(),
        settings: &plan.traced,
        sampling: Sampling::Cosine,
        pieces: &senders.pieces,
    };
    let (mut rays_off, mut all) = (0.0, 0);
    for (pixel, sets) in found.iter().enumerate() {
        let own = &taken.counts[pixel];
        let seen = u32::from(receivers[pixel].is_some());
        assert_eq!(own.rays, seen * 4 * (1 + sets), "pixel {pixel}");
        let open = |ray| nearest(ray, &senders.pieces, 1.5).is_none();
        let rays = tracing.further_rays(pixel, *sets);
        all += rays.len();
        let open = rays.iter().filter(|ray| open(ray)).count() as f64;
        rays_off += (own.sum.x - open).abs();
    }
    println!("{rays_off} of {all} further rays differ");
    assert!(rays_off <= 1e-3 * all as f64, "{rays_off} of {all}");

    let all_near: Vec<u32> = lab().gpu.read_buffer(taken.view.nearness());
    mirror.nearness = &all_near;
    mirror.counts = Some(&taken.counts);
    let picture = mirror.reconstruct(&mirror.average(), &mirror.near());
    let off = |(texel, mirror): (&[f32; 4], &Option<DVec3>)| {
        (f64::from(texel[0]) - mirror.map_or(1.0, |value| value.x)).abs()
    };
    let worst = taken
        .picture
        .iter()
        .zip(&picture)
        .map(off)
        .fold(0.0, f64::max);
    assert!(worst <= 6e-5, "{worst}");
}

/// Sums of radiance over nine further sets have a mean like the first one's: of values over six decades the means of so many rays
/// have a deviation of some 2 %. And they are in the picture.
#[test]
fn further_radiance_has_the_mean_of_the_first() {
    let (shot, senders) = room_shot();
    let (buffer, _) = lab().motley(&senders);
    let settings = RayBudgetSettings {
        rays_per_pixel: 255.0,
        most: 160,
    };
    let plan = Plan {
        further: Some(settings),
        radiance: Some(&buffer),
        filter: own(),
        ..Plan::new(Payload::Radiance, rays(16))
    };
    let taken = take(&shot, &senders, &plan);
    let first = incoming(&taken, &plan);
    // The budget is more than can be spent: all pixels have all that they may.
    let seen: Vec<_> = taken.counts.iter().filter(|c| c.rays > 0).collect();
    assert!(seen.iter().all(|c| c.rays == 160), "{:?}", seen[0]);
    let luma = |c: DVec3| c.element_sum() / 3.0;
    let of_first = first.iter().map(|c| luma(*c)).sum::<f64>() / (16 * seen.len()) as f64;
    let of_more = seen.iter().map(|c| luma(c.sum)).sum::<f64>() / (144 * seen.len()) as f64;
    println!("means {of_first:.2} and {of_more:.2}");
    assert!(
        (of_first / of_more - 1.0).abs() < 0.06,
        "{of_first}, {of_more}"
    );
    for (i, (texel, own)) in taken.picture.iter().zip(&taken.counts).enumerate() {
        if own.rays > 0 {
            let sum: DVec3 = first[16 * i..16 * (i + 1)].iter().sum();
            let material = shot.pixels[i].expect("seen").triangle;
            let albedo = scenes::closed_room().triangle_materials()[material].albedo[0];
            let mean = (sum + own.sum).x / 160.0 * f64::from(albedo);
            assert!(
                (f64::from(texel[0]) - mean).abs() <= 1e-4 * mean.max(1e-3),
                "{i}"
            );
        }
    }
}

/// Further rays follow from what the surroundings' rays bring, not from a pixel's own: the mean over pixels stays that of the
/// truth, within three of its standard errors, as it is without (`hit_resolver::rays_have_no_bias`). The spread of pixels'
/// errors overstates those, as pixels share the stratification of their rays.
#[test]
fn further_rays_have_no_bias() {
    for (scene, radius) in [(scenes::cornell(), 1.0), (scenes::closed_room(), 1.5)] {
        let shot = shot_of(&scene, 0, [48, 48]);
        let senders = lab().senders(&shot.buffers.meshes(), &shot.camera, &triangles(), AMPLE);
        let expected = truth(&shot, f64::from(radius), 1024);
        for (first, more) in [(1, 3.0), (2, 2.0), (4, 12.0)] {
            let mut mean = 0.0;
            let mut variance = 0.0;
            let frames = 8;
            for frame in 0..frames {
                let mut plan = Plan {
                    filter: own(),
                    further: Some(further(more)),
                    ..Plan::new(Payload::Occlusion, rays(first))
                };
                plan.traced.radius = radius;
                plan.traced.frame = 977 * frame;
                let taken = take(&shot, &senders, &plan);
                let found: Vec<f64> = taken.picture.iter().map(|t| t[0].into()).collect();
                let errors = errors(&shot, &found, &expected);
                mean += errors.iter().sum::<f64>() / errors.len() as f64 / f64::from(frames);
                variance += rms(&errors).powi(2) / errors.len() as f64 / f64::from(frames).powi(2);
            }
            let standard_error = variance.sqrt();
            let inputs = format!("{} {first} + {more}", scene.name);
            println!("{inputs}: mean error {mean:.2e}, standard error {standard_error:.2e}");
            assert!(
                mean.abs() <= 3.0 * standard_error,
                "{inputs}: {mean}, {standard_error}"
            );
        }
    }
}

/// The budget is spent: as many rays as were asked for, within the chance of parts of sets.
#[test]
fn the_budget_is_spent_where_it_helps() {
    let (shot, senders) = room_shot();
    let seen = shot.pixels.iter().flatten().count() as f64;
    for more in [0.0, 0.5, 4.0, 20.0] {
        let plan = Plan {
            further: Some(further(more)),
            ..Plan::new(Payload::Occlusion, rays(4))
        };
        let taken = take(&shot, &senders, &plan);
        let spent = f64::from(taken.rays()) / seen - 4.0;
        println!("asked for {more}, spent {spent:.3}");
        assert!(
            (spent - f64::from(more)).abs() <= 0.05 * f64::from(more) + 0.02,
            "{spent}"
        );
    }
}

/// Where all pixels are listed the picture has the same bits as without a list.
#[test]
fn a_list_of_all_pixels_is_the_whole_picture() {
    let lab = lab();
    let (shot, senders) = room_shot();
    let Viewport { width, height, .. } = shot.camera.viewport();
    let mut list = vec![width * height];
    list.extend((0..width * height).map(|i| (i % width) | ((i / width) << 16)));
    let pixels = lab.gpu.buffer(&list, wgpu::BufferUsages::STORAGE);
    let groups = [(width * height).div_ceil(64), 1, 1];
    let dispatch = lab.gpu.buffer(&groups, wgpu::BufferUsages::INDIRECT);
    let all = [PixelList {
        level: 0,
        pixels: &pixels,
        dispatch: &dispatch,
    }];
    // Twice the same list is once.
    let twice = [all[0], all[0]];
    let (buffer, _) = lab.motley(&senders);
    for (payload, radiance) in [
        (Payload::Occlusion, None),
        (Payload::Radiance, Some(&buffer)),
    ] {
        let plan = Plan {
            radiance,
            ..Plan::new(payload, rays(5))
        };
        let whole = take(&shot, &senders, &plan);
        for pixels in [&all[..], &twice[..]] {
            let listed = take(
                &shot,
                &senders,
                &Plan {
                    pixels: Some(pixels),
                    ..plan
                },
            );
            assert_eq!(listed.counts, whole.counts);
            assert_eq!(listed.nearness, whole.nearness);
            assert_eq!(listed.picture, whole.picture);
        }
    }
}

/// With the lists of a multi-resolution mask there are rays at edges and at one pixel in four or sixteen elsewhere, and the
/// others take theirs: the error grows with what is left out, and stays small.
#[test]
fn pixels_without_rays_take_their_neighbours() {
    let lab = lab();
    let device = &lab.gpu.device;
    let shot = shot_of(&scenes::cornell(), 0, [64, 64]);
    let senders = lab.senders(&shot.buffers.meshes(), &shot.camera, &triangles(), AMPLE);
    let mask = pipelines::once(&"mask of rays", |gpu| {
        MultiResMask::new(&gpu.device).expect("pipelines")
    });
    let seen = shot.pixels.iter().flatten().count() as f64;
    let expected = truth(&shot, 1.0, 1024);
    let mut last = 0.0;
    for coarsest in [0, 1, 2] {
        let mut levels = [None; 4];
        levels[0] = Some(MultiResLevel::new(0.5, f32::INFINITY));
        levels[coarsest] = Some(MultiResLevel::new(0.0, 1.0));
        let settings = MultiResMaskSettings::with_levels(levels);
        let mut masks = mask.create_view(device, 64, 64, false).expect("masks");
        let mut encoder = lab.gpu.encoder();
        let input = MultiResMaskInput::new(shot.gbuffer(), &shot.camera);
        mask.record(device, &mut encoder, &input, &settings, &mut masks)
            .expect("a mask");
        lab.gpu.finish(encoder);
        let works: Vec<_> = masks.works().collect();
        let mut plan = Plan {
            pixels: Some(&works),
            filter: HitResolverSettings::for_occlusion(16),
            ..Plan::new(Payload::Occlusion, rays(16))
        };
        plan.traced.radius = 1.0;
        let taken = take(&shot, &senders, &plan);
        let found: Vec<f64> = taken.picture.iter().map(|t| t[0].into()).collect();
        let error = rms(&errors(&shot, &found, &expected));
        let share = f64::from(taken.rays()) / (16.0 * seen);
        println!("coarsest level {coarsest}: {share:.2} of the rays, error {error:.4}");
        assert!(coarsest == 0 || share < 0.8, "{share}");
        assert!((coarsest == 0) == (share == 1.0));
        assert!(error < 0.06 && error > last, "{error} after {last}");
        last = error;
    }
}

/// One pixel, nothing but sky, no rays, no filter to speak of: finite, and the neutral value where nothing is known.
#[test]
fn extremes_are_finite() {
    let lab = lab();
    let scene = scenes::cornell();
    let away = |size: [u32; 2]| {
        let plain = shot_of(&scene, 0, size).camera;
        let behind = 2.0 * plain.eye() - DVec3::from(scene.views[0].target);
        let (projection, viewport) = (plain.projection(), plain.viewport());
        let camera = deep_screen_space::Camera::look_at(
            plain.eye() + (behind - plain.eye()) * 10.0,
            plain.eye() + (behind - plain.eye()) * 20.0,
            DVec3::Y,
            projection,
            viewport,
        );
        Shot::new(lab.gpu, &scene, &camera.expect("a camera"))
    };
    for shot in [
        shot_of(&scene, 0, [1, 1]),
        shot_of(&scene, 1, [17, 3]),
        away([9, 9]),
    ] {
        let senders = lab.senders(&shot.buffers.meshes(), &shot.camera, &triangles(), AMPLE);
        for (first, more, most) in [(0, 4.0, 128), (1, 255.0, 255), (64, 64.0, 0), (3, 0.0, 9)] {
            let plan = Plan {
                further: Some(RayBudgetSettings {
                    rays_per_pixel: more,
                    most,
                }),
                filter: HitResolverSettings {
                    radius: 16,
                    spread: f32::INFINITY,
                    hit_distances: f32::MIN_POSITIVE,
                    ..HitResolverSettings::default()
                },
                ..Plan::new(Payload::Occlusion, rays(first))
            };
            let taken = take(&shot, &senders, &plan);
            assert!(taken.counts.iter().all(|c| c.rays <= most.max(first)));
            let sane = |texel: &[f32; 4]| (0.0..=1.0).contains(&texel[0]);
            assert!(taken.picture.iter().all(sane), "{first} {more} {most}");
            if first == 0 || shot.pixels.iter().all(Option::is_none) {
                assert!(taken.picture.iter().all(|texel| texel[0] == 1.0));
            }
        }
    }
}

#[test]
fn what_does_not_fit_is_refused() {
    let most = |most| RayBudgetSettings {
        most,
        ..RayBudgetSettings::default()
    };
    fields_refused(
        [
            (further(-1.0), "RayBudgetSettings::rays_per_pixel"),
            (further(f32::NAN), "RayBudgetSettings::rays_per_pixel"),
            (most(256), "RayBudgetSettings::most"),
        ],
        RayBudgetSettings::validate,
    );
    let lab = lab();
    let device = &lab.gpu.device;
    let (shot, senders) = room_shot();
    let Viewport { width, height, .. } = shot.camera.viewport();
    let mut encoder = lab.gpu.encoder();
    let mut decoded = Decoded::of(&shot.camera);
    let origin = senders.cloud.origin();
    let frame = decoded.frame(&mut encoder, shot.gbuffer(), &shot.camera, origin);
    let input = BouncedInput::new(&frame, &senders.cloud, &senders.bounds);
    let settings = rays(4);

    // Lists, and further rays, without counts.
    let plain = lab.tracer(Payload::Occlusion, Sampling::Cosine);
    let view = plain.create_view(device, width, height, 4).expect("a view");
    let listed = BouncedInput {
        pixels: Some(&[]),
        ..input
    };
    let found = plain.record(device, &mut encoder, &listed, &settings, &view);
    refused(
        found,
        "Mismatch",
        "BouncedInput::pixels",
        "BouncedDescriptor::counted",
    );
    let room = budget().create_view(device, width, height).expect("a view");
    plain
        .record(device, &mut encoder, &input, &settings, &view)
        .expect("hits");
    let found = plain.record_more(device, &mut encoder, &input, &settings, (&view, &room));
    refused(
        found,
        "Mismatch",
        "RayBudgetView",
        "BouncedDescriptor::counted",
    );

    // Before anything was recorded, with other settings, of another size.
    let (tracer, resolver) = (tracer(Payload::Occlusion), resolver(Payload::Occlusion));
    let view = tracer
        .create_view(device, width, height, 8)
        .expect("a view");
    let more = |encoder: &mut _, settings: &_, room: &_| {
        tracer.record_more(device, encoder, &input, settings, (&view, room))
    };
    refused(
        more(&mut encoder, &settings, &room),
        "Recording",
        "BouncedView",
        "",
    );
    tracer
        .record(device, &mut encoder, &input, &settings, &view)
        .expect("hits");
    refused(
        more(&mut encoder, &settings, &room),
        "Recording",
        "RayBudgetView",
        "",
    );
    refused(
        more(&mut encoder, &rays(5), &room),
        "Mismatch",
        "BouncedSettings",
        "",
    );
    let scratch = resolver.create_view(device, &view).expect("a view");
    let filter = HitResolverSettings::default();
    let wanted = RayBudgetInput::new(&frame, &view, &scratch, &filter);
    let choose = |encoder: &mut _, settings: &_, room: &_| {
        budget().record(device, encoder, &wanted, settings, room)
    };
    let usual = RayBudgetSettings::default();
    refused(
        choose(&mut encoder, &usual, &room),
        "Recording",
        "HitResolverView",
        "",
    );
    resolver
        .estimate(
            device,
            &mut encoder,
            &HitEstimateInput::new(&frame, &view),
            &filter,
            &scratch,
        )
        .expect("means");
    let glossy = RayBudget::with_sampling(device, Sampling::Glossy).expect("pipelines");
    let found = glossy.record(device, &mut encoder, &wanted, &usual, &room);
    refused(
        found,
        "Mismatch",
        "RayBudgetInput::hits",
        "Sampling::Glossy",
    );
    let small = budget().create_view(device, 4, 4).expect("a view");
    refused(
        choose(&mut encoder, &usual, &small),
        "Mismatch",
        "RayBudgetView",
        "",
    );
    choose(&mut encoder, &usual, &room).expect("a budget");
    more(&mut encoder, &settings, &room).expect("further rays");
    // Those were all that there are.
    refused(
        more(&mut encoder, &settings, &room),
        "Recording",
        "BouncedView",
        "already",
    );
    let found = budget().create_view(device, 0, 4).map(|_| ());
    refused(found, "Setting", "view size", "at least 1x1 pixels");

    // Single hits of further rays are not kept.
    let deferred = pipelines::hit_resolver(&HitResolverDescriptor {
        payload: Payload::Occlusion,
        sampling: Sampling::Cosine,
        deferred: true,
        counted: true,
        joined: false,
        bent_normals: false,
        emitter_samples: 0,
        target: wgpu::TextureFormat::Rgba32Float,
    });
    let target = lab
        .gpu
        .target(wgpu::TextureFormat::Rgba32Float, width, height);
    let resolved = HitResolverInput::new(&frame, &view, target.texture());
    let scratch = deferred.create_view(device, &view).expect("a view");
    let found = deferred.record(device, &mut encoder, &resolved, &filter, &scratch);
    refused(found, "Mismatch", "HitResolverInput::hits", "deferred");
}
