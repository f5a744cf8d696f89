//! Shadows by rays, and by several points of a surfel.

use std::f64::consts::PI;

use deep_screen_space::{
    Camera, CloudCapacity, Error, Light, Primitives, ShadedLight, Shadow, ShadowMap,
    SurfelShaderInput, SurfelShaderSettings, SurfelizerSettings, Viewport,
    glam::DVec3,
    reference::{self, trace::Tracer},
    scenes, wgpu,
};

use support::{
    raster::perspective,
    testing::{pipelines, rays, shot::camera_of},
};

use super::harness::{Convention, DepthMap, Lab, above, color, material, point, squares};

/// Shadows by rays are the ray tracer's but for surfels at a shadow's very edge, and for those on a crease, where the ray
/// starts off the surface by some 1e-6 of its distance. Bounds of another cloud are refused.
#[test]
fn traced_shadows_are_the_tracers() {
    let lab = Lab::new();
    let device = &lab.gpu.device;
    for (scene, light) in [
        (
            scenes::cornell(),
            point(DVec3::new(0.6, 4.3, 0.4), [20.0, 18.0, 14.0]),
        ),
        (
            scenes::closed_room(),
            point(DVec3::new(-0.83, 2.1, 0.52), [5.0; 3]),
        ),
        (
            scenes::dominoes(),
            Light::Directional {
                direction: DVec3::new(0.31, -1.0, 0.17),
                irradiance: [3.0, 2.0, 1.0],
            },
        ),
    ] {
        let settings = SurfelizerSettings {
            radius_pixels: 2.0,
            density: f32::INFINITY,
            ..SurfelizerSettings::default()
        };
        let lit = lab.cloud(&scene, &camera_of(&scene, 0, [64, 64]), &settings);
        let bounds = pipelines::bvh_builder(Primitives::Triangles)
            .create(device, &lit.cloud)
            .expect("bounds");
        let mut encoder = lab.gpu.encoder();
        pipelines::bvh_builder(Primitives::Triangles)
            .record(device, &mut encoder, &lit.cloud, &bounds, None)
            .expect("bounds");
        lab.gpu.finish(encoder);
        let materials = scene.material_table();
        let shaded = ShadedLight {
            light,
            shadow: Shadow::Traced(&bounds),
        };
        let tracer = Tracer::new(&scene.positions, &scene.indices).expect("a scene");
        for samples in [1, 4] {
            let found = lab.shade(&lit, &materials, &[shaded], samples);
            let (mut wrong, mut dark) = (0, 0);
            for (surfel, found) in lit.surfels.iter().zip(&found) {
                let material = materials[surfel.material as usize];
                let points: Vec<DVec3> = match surfel.leaf {
                    Some(leaf) if samples > 1 => (0..samples)
                        .map(|k| {
                            let t = reference::surfelizer::leaf_of(leaf, k, samples.ilog2());
                            (t.a + t.b + t.c) / 3.0
                        })
                        .collect(),
                    _ => vec![surfel.position],
                };
                let direct = |normal| {
                    let each =
                        |p: &DVec3| tracer.direct(*p, normal, color(material.albedo), &[light]);
                    points.iter().map(each).sum::<DVec3>() / points.len() as f64
                };
                let front = direct(surfel.normal) + color(material.emission) / PI;
                let back = direct(-surfel.normal);
                dark += usize::from(front == DVec3::ZERO && back == DVec3::ZERO);
                // A packed normal is off by 5e-5, which counts where light grazes.
                wrong += usize::from([(found.front, front), (found.back, back)].into_iter().any(
                    |(found, expected)| {
                        (color(found) - expected).abs().max_element()
                            > 1e-3 * expected.max_element() + 1e-5
                    },
                ));
            }
            let name = format!("{}, {samples} samples", scene.name);
            println!("{name}: {wrong} of {} differ, {dark} are dark", found.len());
            assert!(dark > found.len() / 100, "{name}: {dark} dark");
            assert!(
                wrong <= 1 + found.len() / 200,
                "{name}: {wrong} of {}",
                found.len()
            );
        }
        let small = lab
            .surfelizer
            .create_cloud(
                device,
                CloudCapacity {
                    surfels: 1,
                    pieces: 1,
                    triangles: 1,
                },
            )
            .expect("a cloud");
        let others = pipelines::bvh_builder(Primitives::Triangles)
            .create(device, &small)
            .expect("bounds");
        let table = lab.gpu.buffer(&materials, wgpu::BufferUsages::STORAGE);
        let radiance = lab
            .shader
            .create_radiance(device, &lit.cloud)
            .expect("room");
        let refused = lab.shader.record(
            device,
            &mut lab.gpu.encoder(),
            &SurfelShaderInput {
                cloud: &lit.cloud,
                materials: &table,
                lights: &[ShadedLight {
                    light,
                    shadow: Shadow::Traced(&others),
                }],
                radiance: &radiance,
                timestamps: None,
            },
            &SurfelShaderSettings { samples: 1 },
        );
        assert!(matches!(refused, Err(Error::Mismatch { name: "Bvh", .. })));
    }
}

/// Lamps on and near the surfaces of a hall that hides nothing from them, from near and from far, lose no light to shadows
/// along rays. 1 surfel in 500 may lie beyond a corner by a rounding.
#[test]
fn traced_shadows_of_lamps_on_surfaces_take_nothing() {
    let lab = Lab::new();
    let device = &lab.gpu.device;
    let scene = rays::hall(&scenes::cornell());
    let materials = scene.material_table();
    for (distance, vfov) in [(-2.0, 60.0), (1e3, 0.5), (1e4, 0.05)] {
        let camera = Camera::look_at(
            DVec3::new(0.0, 1.7, 20.0 + distance),
            DVec3::new(0.0, 3.0, 0.0),
            DVec3::Y,
            perspective(vfov, 1.0, f64::max(distance - 10.0, 0.1)),
            Viewport::full(48, 48),
        )
        .expect("a camera");
        let lit = lab.cloud(&scene, &camera, &SurfelizerSettings::default());
        let bounds = pipelines::bvh_builder(Primitives::Triangles)
            .create(device, &lit.cloud)
            .expect("bounds");
        let mut encoder = lab.gpu.encoder();
        pipelines::bvh_builder(Primitives::Triangles)
            .record(device, &mut encoder, &lit.cloud, &bounds, None)
            .expect("bounds");
        lab.gpu.finish(encoder);
        for light in rays::lamps() {
            for samples in [1, 4] {
                let shade =
                    |shadow| lab.shade(&lit, &materials, &[ShadedLight { light, shadow }], samples);
                let all = shade(Shadow::None);
                let found = shade(Shadow::Traced(&bounds));
                let (mut facing, mut dark) = (0, 0);
                for (surfel, (found, all)) in lit.surfels.iter().zip(found.iter().zip(&all)) {
                    let to_light = reference::light::arrival(&light, surfel.position).to_light;
                    // A lamp within some roundings of a surface's plane may be behind it.
                    if surfel.normal.dot(to_light) > 1e-2 && all.front != [0.0; 3] {
                        facing += 1;
                        dark += usize::from(found.front != all.front);
                    }
                }
                assert!(facing > 500, "{distance} {light:?}: {facing} lit");
                assert!(
                    dark <= facing / 500,
                    "{distance} {light:?}, {samples} samples: {dark} of {facing}"
                );
            }
        }
    }
}

/// Several points per surfel average a shadow's edge: the light that a coarse cloud sends comes nearer to the truth, and a
/// share of it is a multiple of 1/n.
#[test]
fn samples_average_edges() {
    let lab = Lab::new();
    let scene = squares(&[(DVec3::ZERO, 2.0), (DVec3::new(0.1, 1.5, 0.05), 0.7)]);
    let settings = SurfelizerSettings {
        radius_pixels: 2.0,
        ..SurfelizerSettings::default()
    };
    let lit = lab.cloud(&scene, &above(5.0), &settings);
    let light = Light::Directional {
        direction: DVec3::new(0.2, -1.0, 0.3),
        irradiance: [PI as f32; 3],
    };
    let cameras = [Camera::look_at(
        DVec3::new(-1.0, 5.0, -1.5),
        DVec3::ZERO,
        DVec3::X,
        Convention::Orthographic.projection(3.0, 0.0, 0.0, 20.0),
        Viewport::full(1024, 1024),
    )
    .expect("a camera")];
    let map = DepthMap::draw(
        lab.gpu,
        &scene,
        &cameras,
        1024,
        wgpu::TextureFormat::Depth32Float,
    );
    let tracer = Tracer::new(&scene.positions, &scene.indices).expect("a scene");
    // The truth of a surfel: the mean over many points of its triangle.
    let truth: Vec<f64> = lit
        .surfels
        .iter()
        .map(|surfel| {
            let leaf = surfel.leaf.expect("a triangle");
            let at = |k| {
                let t = reference::surfelizer::leaf_of(leaf, k, 8);
                let p = (t.a + t.b + t.c) / 3.0;
                tracer.direct(p, surfel.normal, DVec3::ONE, &[light]).x
            };
            (0..256).map(at).sum::<f64>() / 256.0
        })
        .collect();
    let whole = truth.iter().copied().fold(0.0, f64::max);
    let mut errors = Vec::new();
    for samples in [1, 2, 4, 8, 16] {
        let shaded = ShadedLight {
            light,
            shadow: Shadow::Map(ShadowMap::new(&map.texture, &cameras)),
        };
        let found = lab.shade(&lit, &[material([1.0; 3], [0.0; 3])], &[shaded], samples);
        let error = (found
            .iter()
            .zip(&truth)
            .map(|(f, t)| (f64::from(f.front[0]) - t).powi(2))
            .sum::<f64>()
            / truth.len() as f64)
            .sqrt();
        println!(
            "{samples} samples: RMSE {error:.4} of {whole:.4}, {} surfels",
            truth.len()
        );
        errors.push(error);
        for found in found {
            let steps = f64::from(found.front[0]) / whole * f64::from(samples);
            assert!((steps - steps.round()).abs() < 1e-4, "{samples}: {found:?}");
        }
    }
    // Down to what the map's texels and the bias leave.
    assert!(
        errors[1] < 0.75 * errors[0] && errors[2] < 0.5 * errors[0] && errors[3] < 0.25 * errors[0],
        "{errors:?}"
    );
    assert!(errors[4] < 1.1 * errors[3], "{errors:?}");
}
