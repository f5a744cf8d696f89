//! The `ShellSplatter`: GPU against the f64 mirror, against closed forms, and at the extremes.

use deep_screen_space::{
    AmbientOcclusion, Camera, ClusterInput, Effect, Error, Geometry, Material, Overlap, Placement,
    Sampling, ShellSplatter, ShellSplatterDescriptor, SplatInput, SplatSettings, SurfelCounts,
    SurfelizerInput, SurfelizerSettings, Viewport,
    glam::DVec3,
    reference::{
        directions,
        effects::{self, Sender},
        hashing,
        shell_splatter::{splat, surface_normals},
    },
    scenes::{self, Part, Scene},
};
use support::testing::frames::Decoded;
use support::testing::pipelines;
use support::testing::shot::{Shot, camera_of};
use support::testing::splats::{Options, Passes, Run, run, splat_settings};
use support::{gpu::Gpu, raster::perspective, scene::SceneBuffers};

/// Largest error of a sum, relative to 1 where sums are small: f32 rounding of positions (1e-7 of the distance from
/// the eye, over a surfel's distance of a few pixels, 1e-2 of it) makes 1e-5 of a contribution near 1, and a few add up.
const TOLERANCE: f64 = 1e-4;
/// How many pixels may exceed it. None, once pairs that lie on the bound of a shell are taken out: rounding decides
/// which level sees those.
const EXCEPTIONS: f64 = 1e-3;

/// Compares all levels with the mirror; returns the share of pixels beyond TOLERANCE, unexplained ones being an error.
fn compare(gpu: &Gpu, run: &Run, effect: AmbientOcclusion, settings: &SplatSettings, name: &str) {
    let disks = run.disks();
    let receivers = run.receivers(gpu);
    let size = run.view.size();
    let mut total_error = vec![0.0_f64; receivers.len()];
    for level in 0..settings.levels {
        // Squares of distances are off by some units of 2^-24 of the position's own square.
        let mirror = splat(&effect, &disks, &receivers, size, level, settings, 2e-5);
        for (i, (&gpu_sum, sum)) in run.sums(gpu, level).iter().zip(&mirror).enumerate() {
            let error = (f64::from(gpu_sum) - sum.value).abs();
            let explained = TOLERANCE * (1.0 + sum.value) + sum.at_a_bound * 1.01;
            assert!(
                error <= explained,
                "{name}: level {level}, pixel {:?}: GPU {gpu_sum}, mirror {sum:?}, receiver {:?}",
                [i as u32 % size[0], i as u32 / size[0]],
                receivers[i]
            );
            total_error[i] += error;
        }
    }
    let beyond = total_error.iter().filter(|e| **e > TOLERANCE).count();
    let share = beyond as f64 / total_error.len() as f64;
    println!(
        "{name}: {beyond} of {} pixels beyond {TOLERANCE}",
        total_error.len()
    );
    assert!(
        share <= EXCEPTIONS,
        "{name}: {beyond} pixels are off by more than {TOLERANCE}"
    );
}

#[test]
fn sums_match_the_mirror() {
    let gpu = pipelines::gpu();
    for (name, view, size, settings, two_sided) in [
        ("cornell", 0, [64, 48], splat_settings(4, 0.02), false),
        ("cornell", 1, [61, 47], splat_settings(5, 0.05), true),
        ("fence", 0, [64, 64], splat_settings(3, 0.01), false),
        (
            "dominoes",
            1,
            [48, 64],
            SplatSettings {
                radius: 0.3,
                seed: 7,
                ..splat_settings(4, 0.02)
            },
            true,
        ),
        (
            "closed_room",
            0,
            [33, 65],
            SplatSettings {
                unbounded: false,
                ..splat_settings(3, 0.03)
            },
            false,
        ),
    ] {
        let scene = scenes::by_name(name).expect("a scene");
        let shot = Shot::new(gpu, &scene, &camera_of(&scene, view, size));
        let effect = AmbientOcclusion {
            two_sided,
            ..AmbientOcclusion::default()
        };
        let passes = Passes::new(&effect.effect(), false);
        let run = run(gpu, &shot, &passes, &Options::new(settings));
        assert_eq!(run.counts.overflow(), 0, "{name}");
        compare(gpu, &run, effect, &settings, name);
    }
}

/// Normals that lean off the surface by an angle, towards where its hash says in each block of 8 x 8 pixels.
fn lean(shot: &mut Shot, gpu: &Gpu, angle: f64) {
    let camera = shot.camera;
    let width = camera.viewport().width;
    let depth: Vec<f32> = (shot.pixels.iter())
        .map(|p| p.map_or(camera.background_depth(), |p| p.depth as f32))
        .collect();
    for (i, pixel) in (0..).zip(&mut shot.pixels) {
        let Some(pixel) = pixel else { continue };
        let [x, y] = [i % width / 8, i / width / 8];
        let turn = std::f64::consts::TAU * hashing::unit_float(hashing::hash2(x, y));
        let surface = pixel.receiver.geometric_normal;
        let aside = directions::tangent_frame(surface) * DVec3::new(turn.cos(), turn.sin(), 0.0);
        pixel.receiver.shading_normal = angle.cos() * surface + angle.sin() * aside;
    }
    let normal: Vec<[f32; 4]> = (shot.pixels.iter())
        .map(|p| p.map_or(DVec3::ZERO, |p| p.receiver.shading_normal))
        .map(|n| n.as_vec3().extend(0.0).to_array())
        .collect();
    shot.upload(gpu, &depth, &normal);
}

/// With the surface's own share, as with shading normals that are its own.
#[test]
fn own_surfaces_match_the_mirror() {
    let gpu = pipelines::gpu();
    for (name, view, size, angle, overlap) in [
        ("dominoes", 1, [61, 47], 0.8, Overlap::Add),
        ("cornell", 0, [48, 33], 1.2, Overlap::Independent),
        ("fence", 0, [40, 40], 0.0, Overlap::Add),
    ] {
        let scene = scenes::by_name(name).expect("a scene");
        let mut shot = Shot::new(gpu, &scene, &camera_of(&scene, view, size));
        lean(&mut shot, gpu, angle);
        let effect = AmbientOcclusion {
            own_surface: true,
            overlap,
            ..AmbientOcclusion::default()
        };
        let settings = splat_settings(2, 0.03);
        let passes = Passes::new(&effect.effect(), false);
        let run = run(gpu, &shot, &passes, &Options::new(settings));
        compare(gpu, &run, effect, &settings, name);

        // The normals that are found are the surface's, but for pixels between edges that leave no line to follow: two in
        // a row or a column, as of thin dominoes at this size.
        let receivers = run.receivers(gpu);
        let found = surface_normals(&receivers, size);
        let pixels = found.iter().zip(&shot.pixels);
        let off = pixels
            .filter_map(|(found, pixel)| Some((*found)?.dot((*pixel)?.receiver.geometric_normal)))
            .filter(|cosine| *cosine < 0.999)
            .count();
        println!("{name}: {off} of {} normals are off", found.len());
        assert!(
            (off as f64) < 0.1 * found.len() as f64,
            "{name}: {off} normals are off"
        );
    }
}

/// A floor, and a wall across it: nothing hides behind anything else, so that sums are right.
fn floor_and_wall() -> Scene {
    let quad = |a: [f32; 3], b: [f32; 3], c: [f32; 3], d: [f32; 3]| [a, b, c, a, c, d];
    let (near, far) = (2.0, -2.0);
    let positions: Vec<[f32; 3]> = [
        quad(
            [-2.0, 0.0, near],
            [2.0, 0.0, near],
            [2.0, 0.0, far],
            [-2.0, 0.0, far],
        ),
        quad(
            [-1.5, 0.0, 0.0],
            [1.5, 0.0, 0.0],
            [1.5, 1.5, 0.0],
            [-1.5, 1.5, 0.0],
        ),
    ]
    .concat();
    Scene {
        normals: vec![[0.0, 1.0, 0.0]; positions.len()],
        indices: (0..positions.len() as u32).collect(),
        parts: vec![Part {
            first_index: 0,
            index_count: positions.len() as u32,
            material: 0,
        }],
        positions,
        ..scenes::cornell()
    }
}

/// Visibility about shading normals that lean off the surface, against rays of which those below the surface are blocked.
/// Without the surface's own share that part of the hemisphere, (1 - cos) / 2, counts as open, but for the floor behind the
/// wall, which a normal that leans down from the wall sees through it.
#[test]
fn leaning_normals_see_their_own_surface() {
    let gpu = pipelines::gpu();
    let scene = floor_and_wall();
    let size = [96, 64];
    let camera = Camera::look_at(
        DVec3::new(0.7, 1.3, 3.0),
        DVec3::new(0.0, 0.5, 0.0),
        DVec3::Y,
        perspective(60.0, 1.5, 0.1),
        Viewport::full(size[0], size[1]),
    )
    .expect("a camera");
    for overlap in [Overlap::Add, Overlap::Independent] {
        let passes = [false, true].map(|own_surface| {
            let effect = AmbientOcclusion {
                own_surface,
                overlap,
                ..AmbientOcclusion::default()
            };
            (effect, Passes::new(&effect.effect(), false))
        });
        // What the effect is off by anyway: exp(-sum) is for what lies independently.
        let mut upright = None;
        for degrees in [0.0_f64, 20.0, 45.0, 70.0] {
            let angle = degrees.to_radians();
            let mut shot = Shot::new(gpu, &scene, &camera);
            lean(&mut shot, gpu, angle);
            let truth = about_shading_normals(&shot);
            let [without, with] = passes.each_ref().map(|(effect, passes)| {
                let mut options = Options::new(splat_settings(1, 0.01));
                options.surfelizer.radius_pixels = 1.0;
                let sums = run(gpu, &shot, passes, &options).sums(gpu, 0);
                let errors: Vec<f64> = (sums.iter().zip(&truth))
                    .filter_map(|(&sum, truth)| Some(effect.visibility(f64::from(sum)) - (*truth)?))
                    .collect();
                errors.iter().sum::<f64>() / errors.len() as f64
            });
            let below = 0.5 - 0.5 * angle.cos();
            println!(
                "{overlap:?}, {degrees} degrees, {below:.3} below: bias {without:+.4} without, {with:+.4} with"
            );
            let anyway = *upright.get_or_insert(without);
            assert!(anyway.abs() < 0.04, "{overlap:?}: {anyway}");
            // And the more so the more there is to multiply.
            let more = if overlap == Overlap::Add {
                0.0
            } else {
                0.25 * below
            };
            assert!(
                (with - anyway).abs() < 0.01 + more,
                "{overlap:?}, {degrees} degrees: {with} for {anyway}"
            );
            assert!(
                without - anyway > 0.8 * below - 0.01,
                "{overlap:?}, {degrees} degrees: {without}, {below} below"
            );
        }
    }
}

/// Of 256 directions about each pixel's shading normal those that are above its surface and meet nothing.
fn about_shading_normals(shot: &Shot) -> Vec<Option<f64>> {
    let width = shot.camera.viewport().width;
    (0..)
        .zip(&shot.pixels)
        .map(|(i, pixel)| {
            let at = (*pixel)?.receiver;
            let origin = at.position + at.geometric_normal * shot.tracer.epsilon();
            let open = (0..256).filter(|&index| {
                let pixel = [i % width, i / width];
                let point = directions::cell_point(pixel, index, [16, 16], 0);
                let normal = at.shading_normal;
                let along =
                    directions::hemisphere_direction(point, normal, Sampling::Cosine).direction;
                let far = f64::INFINITY;
                along.dot(at.geometric_normal) > 0.0
                    && !shot.tracer.occluded(origin, along, 0.0, far)
            });
            Some(open.count() as f64 / 256.0)
        })
        .collect()
}

/// A square of side 2 s at height h over a floor pixel, of one surfel: the sum is the form factor of a disk of its area.
#[test]
fn one_surfel_gives_the_form_factor() {
    let gpu = pipelines::gpu();
    let passes = Passes::new(&AmbientOcclusion::default().effect(), false);
    for (height, lean) in [(0.5_f64, 0.0_f64), (1.0, 0.0), (1.0, 0.7), (3.0, -0.4)] {
        // A small triangle facing down, centred `lean` beside the point below it.
        let s = 0.05_f64;
        let corner = |angle: f64| {
            let a = angle.to_radians();
            [
                (lean + s * a.cos()) as f32,
                height as f32,
                (s * a.sin()) as f32,
            ]
        };
        let floor = 4.0_f32;
        let scene = Scene {
            name: "one surfel",
            positions: vec![
                corner(0.0),
                corner(120.0),
                corner(240.0),
                [-floor, 0.0, -floor],
                [-floor, 0.0, floor],
                [floor, 0.0, 0.0],
            ],
            normals: vec![[0.0, 1.0, 0.0]; 6],
            indices: vec![0, 1, 2, 3, 4, 5],
            ..scenes::by_name("cornell").expect("a scene")
        };
        let scene = Scene {
            parts: vec![scenes::Part {
                first_index: 0,
                index_count: 6,
                material: 0,
            }],
            ..scene
        };
        // Looks at the origin from the side, below the triangle.
        let camera = Camera::look_at(
            DVec3::new(0.0, 0.2, 6.0),
            DVec3::ZERO,
            DVec3::Y,
            perspective(1.0, 1.0, 0.1),
            Viewport::full(1, 1),
        )
        .expect("a camera");
        let shot = Shot::new(gpu, &scene, &camera);
        let settings = splat_settings(1, 1e-6);
        let mut options = Options::new(settings);
        options.surfelizer.radius_pixels = 1000.0;
        options.surfelizer.density = f32::INFINITY;
        let run = run(gpu, &shot, &passes, &options);
        let area = 3.0 * 3.0_f64.sqrt() / 4.0 * s * s;
        let r2 = area / std::f64::consts::PI;
        let d2 = height * height + lean * lean;
        // Both cosines are height / distance: floor and triangle are parallel.
        let expected = r2 / (d2 + r2) * height * height / d2;
        let sum = f64::from(run.sums(gpu, 0)[0]);
        // The floor's own surfels lie in its plane. 1e-3: the pixel's ray meets the floor a rounding off the origin.
        assert!(
            (sum - expected).abs() <= 1e-3 * expected,
            "height {height}, lean {lean}: sum {sum}, form factor {expected}"
        );
    }
}

/// Over the permutations a pixel is as likely in one sub-buffer as in another, so the mean over them is the sum over
/// all surfels. 64 of them: the mean's error is taken from their spread, and 4.5 of it bounds some thousand pixels.
#[test]
fn levels_change_nothing_in_expectation() {
    let gpu = pipelines::gpu();
    let scene = scenes::by_name("cornell").expect("a scene");
    let shot = Shot::new(gpu, &scene, &camera_of(&scene, 1, [24, 24]));
    let passes = Passes::new(&AmbientOcclusion::default().effect(), false);
    let full = run(gpu, &shot, &passes, &Options::new(splat_settings(1, 1e-9))).total(gpu, 1);
    let seeds = 64;
    let mut sum = vec![0.0_f64; full.len()];
    let mut square = vec![0.0_f64; full.len()];
    for seed in 0..seeds {
        let settings = SplatSettings {
            seed,
            ..splat_settings(3, 0.05)
        };
        let total = run(gpu, &shot, &passes, &Options::new(settings)).total(gpu, 3);
        for (i, v) in total.iter().enumerate() {
            sum[i] += f64::from(*v);
            square[i] += f64::from(*v) * f64::from(*v);
        }
    }
    let n = f64::from(seeds);
    let mut bias = 0.0;
    for i in 0..full.len() {
        let mean = sum[i] / n;
        let error = ((square[i] / n - mean * mean).max(0.0) / (n - 1.0)).sqrt();
        let off = mean - f64::from(full[i]);
        bias += off / full.len() as f64;
        assert!(
            off.abs() <= 4.5 * error + 1e-3,
            "pixel {i}: mean {mean} +- {error} over {seeds} permutations, all surfels {}",
            full[i]
        );
    }
    assert!(bias.abs() < 2e-3, "mean bias {bias}");
}

/// Smaller thresholds, fewer levels and smaller surfels approach the sum over the finest cloud.
#[test]
fn converges_to_the_sum_over_all_surfels() {
    let gpu = pipelines::gpu();
    let scene = scenes::by_name("cornell").expect("a scene");
    let shot = Shot::new(gpu, &scene, &camera_of(&scene, 1, [32, 32]));
    let passes = Passes::new(&AmbientOcclusion::default().effect(), false);
    let image = |radius_pixels: f32, levels: u32, epsilon: f32| {
        let mut options = Options::new(splat_settings(levels, epsilon));
        options.surfelizer.radius_pixels = radius_pixels;
        run(gpu, &shot, &passes, &options).total(gpu, levels)
    };
    let truth = image(0.35, 1, 1e-9);
    let rmse = |image: &[f32]| {
        let sum: f64 = image
            .iter()
            .zip(&truth)
            .map(|(a, b)| f64::from(a - b).powi(2))
            .sum();
        (sum / truth.len() as f64).sqrt()
    };
    let by_epsilon: Vec<f64> = [0.2, 0.02, 0.002]
        .map(|epsilon| rmse(&image(0.35, 4, epsilon)))
        .to_vec();
    let by_radius: Vec<f64> = [4.0, 2.0, 1.0, 0.5]
        .map(|s| rmse(&image(s, 1, 1e-9)))
        .to_vec();
    let by_levels: Vec<f64> = [4, 3, 2, 1].map(|l| rmse(&image(0.35, l, 0.05))).to_vec();
    println!("epsilon {by_epsilon:?}\nradius {by_radius:?}\nlevels {by_levels:?}");
    for curve in [&by_epsilon, &by_radius, &by_levels] {
        assert!(
            curve.windows(2).all(|w| w[1] < w[0]),
            "not falling: {curve:?}"
        );
    }
    // One level sees every surfel, whatever the threshold, since the last has no outer bound.
    assert!(by_levels[3] < 1e-5, "{by_levels:?}");
    assert!(by_radius[3] < 0.02, "{by_radius:?}");
}

/// An engine's own effect: light from emitting materials, three channels.
fn emission_effect() -> Effect {
    Effect {
        channels: 3,
        materials: true,
        constants: vec![("GAIN".into(), 2.0)],
        ..Effect::new(
            "emission",
            "
override GAIN: f32 = 1.0;
fn max_distance(sender: Sender, epsilon: f32) -> f32 {
  let brightest = max_component(sender.material.emission) * GAIN;
  return sender.radius * sqrt(max(brightest / epsilon - 1.0, 0.0));
}
fn contribution(sender: Sender, receiver_normal: vec3f, to_sender: vec3f, distance2: f32) -> vec3f {
  let receiver_side = max(dot(receiver_normal, to_sender), 0.0);
  let sender_side = max(-dot(sender.normal, to_sender), 0.0);
  let r2 = sender.radius * sender.radius;
  let factor = receiver_side * sender_side * r2 / (max(distance2, 1e-20) * (distance2 + r2));
  return GAIN * factor * sender.material.emission;
}
fn resolve(sum: vec3f, albedo: vec3f) -> vec4f {
  return vec4f(sum * albedo, 1.0);
}
",
        )
    }
}

struct Emission;

#[derive(Clone, Copy, Debug, Default)]
struct Light(DVec3);

impl std::ops::AddAssign for Light {
    fn add_assign(&mut self, other: Self) {
        self.0 += other.0;
    }
}

impl std::ops::Mul<f64> for Light {
    type Output = Self;
    fn mul(self, by: f64) -> Self {
        Self(self.0 * by)
    }
}

impl effects::Effect for Emission {
    type Sum = Light;

    fn max_distance(&self, sender: &Sender, epsilon: f64) -> f64 {
        sender.radius
            * (2.0 * sender.emission.max_element() / epsilon - 1.0)
                .max(0.0)
                .sqrt()
    }

    fn contribution(
        &self,
        sender: &Sender,
        receiver: &effects::Receiver,
        to_sender: DVec3,
        distance2: f64,
    ) -> Light {
        let sides =
            receiver.normal.dot(to_sender).max(0.0) * (-sender.normal.dot(to_sender)).max(0.0);
        let r2 = sender.radius * sender.radius;
        Light(2.0 * sides * r2 / (distance2.max(1e-20) * (distance2 + r2)) * sender.emission)
    }
}

#[test]
fn an_effect_of_ones_own_reads_materials() {
    let gpu = pipelines::gpu();
    let scene = scenes::by_name("cornell").expect("a scene");
    let shot = Shot::new(gpu, &scene, &camera_of(&scene, 0, [40, 40]));
    let materials: Vec<Material> = (0..scene.materials.len())
        .map(|i| Material {
            emission: [0.0, 1.0, 2.0].map(|c| {
                if i % 3 == 0 {
                    0.0
                } else {
                    0.25 * (c + i as f32)
                }
            }),
            ..Material::default()
        })
        .collect();
    let settings = SplatSettings {
        unbounded: false,
        ..splat_settings(3, 0.01)
    };
    let mut options = Options::new(settings);
    options.materials = Some(materials.clone());
    let mut brightest = 0.0_f32;
    for subgroups in variants(gpu) {
        let passes = Passes::new(&emission_effect(), subgroups);
        let run = run(gpu, &shot, &passes, &options);
        let disks = run.disks_of(&options);
        let receivers = run.receivers(gpu);
        for level in 0..3 {
            let mirror = splat(
                &Emission,
                &disks,
                &receivers,
                [40, 40],
                level,
                &settings,
                2e-5,
            );
            let sums: Vec<[f32; 4]> = gpu.read_texture(run.view.sums().texture(), level);
            for (i, (sum, expected)) in sums.iter().zip(&mirror).enumerate() {
                for channel in 0..3 {
                    brightest = brightest.max(sum[channel]);
                    let error = (f64::from(sum[channel]) - expected.value.0[channel]).abs();
                    let explained = TOLERANCE * (1.0 + expected.value.0[channel])
                        + 1.01 * expected.at_a_bound.0[channel];
                    assert!(
                        error <= explained,
                        "level {level}, pixel {i}: {sum:?}, {expected:?}"
                    );
                }
            }
        }
    }
    assert!(brightest > 0.1, "nothing was lit");
}

#[test]
fn subgroups_give_the_same_sums() {
    let gpu = pipelines::gpu();
    if !gpu
        .device
        .features()
        .contains(ShellSplatter::optional_features())
    {
        // Under DSS_LIMITS=default the feature is not asked for; then asking for it must say so.
        let effect = AmbientOcclusion::default().effect();
        let refused = ShellSplatter::new(
            &gpu.device,
            &ShellSplatterDescriptor {
                effect: &effect,
                subgroups: true,
                statistics: false,
            },
        );
        assert!(matches!(refused, Err(Error::Feature { .. })), "{refused:?}");
        return;
    }
    let scene = scenes::by_name("fence").expect("a scene");
    let shot = Shot::new(gpu, &scene, &camera_of(&scene, 1, [61, 45]));
    let effect = AmbientOcclusion::default().effect();
    let options = Options::new(splat_settings(4, 0.02));
    let plain = run(gpu, &shot, &Passes::new(&effect, false), &options).total(gpu, 4);
    let subgroups = run(gpu, &shot, &Passes::new(&effect, true), &options).total(gpu, 4);
    // The same surfels in the same order: bit for bit.
    assert!(plain == subgroups);
}

/// Without subgroups, and with them where the device has them.
fn variants(gpu: &Gpu) -> Vec<bool> {
    let features = gpu.device.features();
    let has_subgroups = features.contains(ShellSplatter::optional_features());
    [false, true][..=usize::from(has_subgroups)].to_vec()
}

/// More surfels than a workgroup tests at once, 2048, and more than its threads have groups for, 65536.
#[test]
fn any_number_of_surfels_about_a_tile() {
    let gpu = pipelines::gpu();
    let scene = scenes::by_name("cornell").expect("a scene");
    let shot = Shot::new(gpu, &scene, &camera_of(&scene, 0, [24, 16]));
    let effect = AmbientOcclusion::default();
    for subgroups in variants(gpu) {
        let passes = Passes::new(&effect.effect(), subgroups);
        for (radius_pixels, least, unbounded) in [(0.15, 4096, true), (0.05, 70_000, false)] {
            let settings = SplatSettings {
                unbounded,
                ..splat_settings(2, 0.002)
            };
            let mut options = Options::new(settings);
            options.surfelizer.radius_pixels = radius_pixels;
            options.capacity.surfels = 1 << 18;
            options.capacity.pieces = 1 << 18;
            let run = run(gpu, &shot, &passes, &options);
            let name = format!("{} surfels, subgroups: {subgroups}", run.surfels.len());
            assert_eq!(run.counts.overflow(), 0, "{name}");
            assert!(run.surfels.len() >= least, "{name}");
            compare(gpu, &run, effect, &settings, &name);
        }
    }
}

#[test]
fn two_runs_give_the_same_sums() {
    let gpu = pipelines::gpu();
    let scene = scenes::by_name("fence").expect("a scene");
    let shot = Shot::new(gpu, &scene, &camera_of(&scene, 0, [48, 48]));
    let passes = Passes::new(&AmbientOcclusion::default().effect(), false);
    let options = Options::new(splat_settings(5, 0.02));
    let first = run(gpu, &shot, &passes, &options).total(gpu, 5);
    let second = run(gpu, &shot, &passes, &options).total(gpu, 5);
    assert!(first.iter().any(|v| *v > 0.1));
    assert!(first == second);
}

/// What must hold whatever the settings: sums are finite and not negative, and where a mirror is cheap, equal to it.
#[test]
fn extremes_of_settings_and_sizes() {
    let gpu = pipelines::gpu();
    let scene = scenes::by_name("cornell").expect("a scene");
    let effect = AmbientOcclusion::default();
    let passes = Passes::new(&effect.effect(), false);
    for (size, levels, epsilon, radius, unbounded) in [
        ([1, 1], 1, 0.01, f32::INFINITY, true),
        ([1, 1], 8, 0.01, f32::INFINITY, true),
        ([1, 37], 3, 0.01, f32::INFINITY, true),
        ([31, 1], 2, 0.5, 0.5, true),
        ([17, 13], 8, 0.05, f32::INFINITY, true),
        ([23, 19], 3, 1e-30, f32::INFINITY, true),
        ([23, 19], 3, 1e-30, f32::INFINITY, false),
        ([23, 19], 3, 1.0, f32::INFINITY, true),
        ([23, 19], 3, 1e30, f32::INFINITY, false),
        ([23, 19], 4, 0.02, 0.0, true),
        ([23, 19], 4, 0.02, f32::MAX, true),
        ([23, 19], 4, 0.02, 1e-30, false),
    ] {
        let name = format!(
            "{size:?}, levels {levels}, epsilon {epsilon}, radius {radius}, unbounded {unbounded}"
        );
        let shot = Shot::new(gpu, &scene, &camera_of(&scene, 0, size));
        let settings = SplatSettings {
            levels,
            epsilon,
            radius,
            unbounded,
            seed: 0,
        };
        let mut options = Options::new(settings);
        options.surfelizer.placement = Placement::Random;
        let run = run(gpu, &shot, &passes, &options);
        for level in 0..levels {
            for v in run.sums(gpu, level) {
                assert!(v.is_finite() && v >= 0.0, "{name}: level {level} has {v}");
            }
        }
        compare(gpu, &run, effect, &settings, &name);
        if radius == 0.0 || (epsilon >= 1.0 && !unbounded) {
            assert!(run.total(gpu, levels).iter().all(|v| *v == 0.0), "{name}");
        }
    }
}

/// Scenes of any scale and place give the picture of the same scene at scale 1 at the origin.
#[test]
fn scale_and_place_change_nothing() {
    let gpu = pipelines::gpu();
    let scene = scenes::by_name("cornell").expect("a scene");
    let passes = Passes::new(&AmbientOcclusion::default().effect(), false);
    let settings = splat_settings(1, 1e-6);
    let camera = camera_of(&scene, 1, [32, 32]);
    let plain = run(
        gpu,
        &Shot::new(gpu, &scene, &camera),
        &passes,
        &Options::new(settings),
    )
    .total(gpu, 1);
    for (scale, shift, tolerance) in [
        (1e-4_f64, DVec3::ZERO, 1e-5),
        (1e5, DVec3::ZERO, 1e-5),
        // Vertices at 1e5 are multiples of 1/128, so that walls of a room of 5 units move by up to 1/256.
        (1.0, DVec3::new(1e5, -1e5, 1e5), 0.01),
    ] {
        let place = |p: [f32; 3]| {
            (DVec3::from(p.map(f64::from)) * scale + shift)
                .as_vec3()
                .to_array()
        };
        let mut moved = scene.clone();
        moved.positions = scene.positions.iter().map(|p| place(*p)).collect();
        let view = &scene.views[1];
        let at = |p: [f64; 3]| DVec3::from(p) * scale + shift;
        let camera = Camera::look_at(
            at(view.eye),
            at(view.target),
            view.up.into(),
            perspective(view.vertical_fov_degrees, 1.0, view.near * scale),
            Viewport::full(32, 32),
        )
        .expect("a camera");
        let total = run(
            gpu,
            &Shot::new(gpu, &moved, &camera),
            &passes,
            &Options::new(settings),
        )
        .total(gpu, 1);
        let square: f64 = total
            .iter()
            .zip(&plain)
            .map(|(a, b)| f64::from(a - b).powi(2))
            .sum();
        let rmse = (square / plain.len() as f64).sqrt();
        println!("scale {scale}, shift {shift}: RMSE {rmse}");
        assert!(
            rmse < tolerance,
            "scale {scale}, shift {shift}: RMSE {rmse}"
        );
    }
}

#[test]
fn nothing_to_splat_gives_zero() {
    let gpu = pipelines::gpu();
    let mut scene = scenes::by_name("cornell").expect("a scene");
    let passes = Passes::new(&AmbientOcclusion::default().effect(), false);
    // A sky-only view: looks away from everything.
    let camera = Camera::look_at(
        DVec3::new(0.0, 0.0, 1e4),
        DVec3::new(0.0, 0.0, 2e4),
        DVec3::Y,
        perspective(40.0, 1.0, 0.1),
        Viewport::full(20, 20),
    )
    .expect("a camera");
    let sky = run(
        gpu,
        &Shot::new(gpu, &scene, &camera),
        &passes,
        &Options::new(splat_settings(3, 0.01)),
    );
    assert!(sky.total(gpu, 3).iter().all(|v| *v == 0.0));
    // An empty scene under the G-buffer of a full one.
    let camera = camera_of(&scene, 0, [20, 20]);
    let mut shot = Shot::new(gpu, &scene, &camera);
    scene.indices.clear();
    scene.parts.clear();
    shot.buffers = SceneBuffers::new(gpu, &scene);
    let empty = run(gpu, &shot, &passes, &Options::new(splat_settings(3, 0.01)));
    assert_eq!(empty.counts, SurfelCounts::default());
    assert!(empty.total(gpu, 3).iter().all(|v| *v == 0.0));
}

/// Two eyes share one cloud, its clusters and the pipelines, in one submission.
#[test]
fn two_views_share_a_cloud() {
    let gpu = pipelines::gpu();
    let device = &gpu.device;
    let scene = scenes::by_name("dominoes").expect("a scene");
    let left = camera_of(&scene, 0, [32, 24]);
    let view = &scene.views[0];
    let aside = DVec3::from(view.target) - DVec3::from(view.eye);
    let shift = aside.cross(DVec3::Y).normalize() * 0.01 * aside.length();
    let right = Camera::look_at(
        DVec3::from(view.eye) + shift,
        DVec3::from(view.target) + shift,
        view.up.into(),
        perspective(view.vertical_fov_degrees, 32.0 / 24.0, view.near),
        Viewport::full(32, 24),
    )
    .expect("a camera");
    let shots = [left, right].map(|camera| Shot::new(gpu, &scene, &camera));
    let effect = AmbientOcclusion::default().effect();
    let settings = splat_settings(3, 0.02);
    let options = Options::new(settings);
    let surfelizer = pipelines::surfelizer();
    let splatter = pipelines::shell_splatter(&effect, false);
    let mut cloud = surfelizer
        .create_cloud(device, options.capacity)
        .expect("a cloud");
    let mut clusters = splatter
        .create_clusters(device, &cloud, 3)
        .expect("clusters");
    let views = [(); 2].map(|()| splatter.create_view(device, 32, 24, 3).expect("a view"));
    let mut encoder = gpu.encoder();
    surfelizer
        .record(
            device,
            &mut encoder,
            &SurfelizerInput {
                geometry: Geometry {
                    meshes: &shots[0].buffers.meshes(),
                },
                camera: &left,
                cull_by: &[left, right],
                timestamps: None,
            },
            &options.surfelizer,
            &mut cloud,
        )
        .expect("surfels");
    splatter
        .record_clusters(
            device,
            &mut encoder,
            &ClusterInput::new(&cloud),
            &settings,
            &mut clusters,
        )
        .expect("clusters");
    let mut decoded = [0, 1].map(|i| Decoded::of(&shots[i].camera));
    for ((shot, view), decoded) in shots.iter().zip(&views).zip(&mut decoded) {
        let frame = decoded.frame(&mut encoder, shot.gbuffer(), &shot.camera, cloud.origin());
        splatter
            .record(
                device,
                &mut encoder,
                &SplatInput::new(&frame, &cloud, &clusters),
                &settings,
                view,
            )
            .expect("sums");
    }
    gpu.finish(encoder);
    let counts: SurfelCounts = gpu.read_buffer(cloud.counters())[0];
    let stored = counts.stored as usize;
    let [first, second] = views;
    let [one, other] = decoded;
    for (decoded, view, name) in [(one, first, "left"), (other, second, "right")] {
        let run = Run {
            decoded,
            view,
            counts,
            surfels: gpu.read_buffer(cloud.surfels())[..stored].to_vec(),
            sources: gpu.read_buffer(cloud.sources())[..stored].to_vec(),
            origin: cloud.origin(),
        };
        compare(gpu, &run, AmbientOcclusion::default(), &settings, name);
        assert!(
            run.total(gpu, 3).iter().any(|v| *v > 0.05),
            "{name} is dark"
        );
    }
}

#[test]
fn bad_settings_are_typed_errors() {
    let fields = [
        (
            SplatSettings {
                levels: 0,
                ..SplatSettings::default()
            },
            "SplatSettings::levels",
        ),
        (
            SplatSettings {
                levels: 9,
                ..SplatSettings::default()
            },
            "SplatSettings::levels",
        ),
        (
            SplatSettings {
                epsilon: 0.0,
                ..SplatSettings::default()
            },
            "SplatSettings::epsilon",
        ),
        (
            SplatSettings {
                epsilon: f32::NAN,
                ..SplatSettings::default()
            },
            "SplatSettings::epsilon",
        ),
        (
            SplatSettings {
                radius: -1.0,
                ..SplatSettings::default()
            },
            "SplatSettings::radius",
        ),
        (
            SplatSettings {
                radius: f32::NAN,
                ..SplatSettings::default()
            },
            "SplatSettings::radius",
        ),
        (
            SplatSettings {
                seed: u32::MAX,
                ..SplatSettings::default()
            },
            "SplatSettings::seed",
        ),
    ];
    for (settings, named) in fields {
        match settings.validate() {
            Err(Error::Setting { field, .. }) => assert_eq!(field, named),
            other => panic!("{settings:?}: {other:?}"),
        }
    }
    let gpu = pipelines::gpu();
    let device = &gpu.device;
    let effect = AmbientOcclusion::default().effect();
    let splatter = pipelines::shell_splatter(&effect, false);
    assert!(matches!(
        splatter.create_view(device, 0, 4, 1),
        Err(Error::Setting { .. })
    ));
    assert!(matches!(
        splatter.create_view(device, 4, 1 << 20, 1),
        Err(Error::Limit { .. })
    ));
    assert!(matches!(
        splatter.create_view(device, 4, 4, 0),
        Err(Error::Setting { .. })
    ));

    // Objects that do not belong together.
    let scene = scenes::by_name("cornell").expect("a scene");
    let shot = Shot::new(gpu, &scene, &camera_of(&scene, 0, [8, 8]));
    let surfelizer = pipelines::surfelizer();
    let options = Options::new(splat_settings(2, 0.01));
    let mut cloud = surfelizer
        .create_cloud(device, options.capacity)
        .expect("a cloud");
    let mut clusters = splatter
        .create_clusters(device, &cloud, 2)
        .expect("clusters");
    let mut encoder = gpu.encoder();
    let input = SurfelizerInput::new(Geometry { meshes: &[] }, &shot.camera);
    let settings = SurfelizerSettings::default();
    surfelizer
        .record(device, &mut encoder, &input, &settings, &mut cloud)
        .expect("surfels");
    let input = ClusterInput::new(&cloud);
    splatter
        .record_clusters(
            device,
            &mut encoder,
            &input,
            &splat_settings(2, 0.01),
            &mut clusters,
        )
        .expect("clusters");
    let mut refused = |splat: &ShellSplatter, levels, epsilon, size: [u32; 2]| {
        let view = splat
            .create_view(device, size[0], size[1], 2)
            .expect("a view");
        let mut decoded = Decoded::of(&shot.camera);
        let frame = decoded.frame(&mut encoder, shot.gbuffer(), &shot.camera, cloud.origin());
        let input = SplatInput::new(&frame, &cloud, &clusters);
        splat
            .record(
                device,
                &mut encoder,
                &input,
                &splat_settings(levels, epsilon),
                &view,
            )
            .expect_err("does not fit")
    };
    // Bounds recorded for shorter reaches would lose what lies beyond them.
    assert!(matches!(
        refused(splatter, 2, 0.001, [8, 8]),
        Error::Mismatch {
            name: "SurfelClusters",
            ..
        }
    ));
    assert!(matches!(
        refused(splatter, 3, 0.01, [8, 8]),
        Error::Mismatch {
            name: "SurfelClusters",
            ..
        }
    ));
    assert!(matches!(
        refused(splatter, 2, 0.01, [8, 9]),
        Error::Mismatch {
            name: "SplatView",
            ..
        }
    ));
    let lit = pipelines::shell_splatter(&emission_effect(), false);
    assert!(matches!(
        refused(lit, 2, 0.01, [8, 8]),
        Error::Buffer {
            name: "materials",
            ..
        }
    ));
}
