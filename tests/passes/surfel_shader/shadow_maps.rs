//! Shadows by maps.

use std::f64::consts::PI;

use deep_screen_space::{
    Camera, Light, ShadedLight, Shadow, ShadowMap, SurfelRadiance, SurfelizerSettings, Viewport,
    glam::DVec3, reference::trace::Tracer, scenes, wgpu,
};

use support::testing::shot::camera_of;

use super::harness::{
    ALBEDO, Convention, DepthMap, Lab, above, color, cube, material, point, quads, squares,
};

/// The inside of a cube of half the side `half`.
fn room(half: f64) -> Vec<[DVec3; 4]> {
    let wall = |axis: DVec3| {
        let (u, v) = axis.any_orthonormal_pair();
        [-u - v, v - u, u + v, u - v].map(|across| (axis + across) * half)
    };
    let axes = DVec3::AXES.into_iter().flat_map(|axis| [axis, -axis]);
    axes.map(wall).collect()
}

/// A square between a light and the ground: a shadow of known size, whatever the map's depth convention and format, and
/// none of a surface on itself.
#[test]
fn shadow_maps_of_all_conventions() {
    let lab = Lab::new();
    let scene = squares(&[(DVec3::ZERO, 3.0), (DVec3::new(0.2, 2.0, 0.0), 0.5)]);
    let fine = SurfelizerSettings {
        radius_pixels: 0.7,
        ..SurfelizerSettings::default()
    };
    let lit = lab.cloud(&scene, &above(6.0), &fine);
    let grey = [material(ALBEDO, [0.0; 3])];
    let from = DVec3::new(1.0, 4.0, 0.5);
    for convention in [
        Convention::Forward,
        Convention::Reversed,
        Convention::InfiniteReversed,
        Convention::Orthographic,
        Convention::OrthographicReversed,
    ] {
        let parallel = matches!(
            convention,
            Convention::Orthographic | Convention::OrthographicReversed
        );
        for (format, bias) in [
            (wgpu::TextureFormat::Depth32Float, 1.0),
            (wgpu::TextureFormat::Depth24Plus, 1.0),
            (wgpu::TextureFormat::Depth16Unorm, 1.0),
            (wgpu::TextureFormat::Depth32Float, 0.0),
        ] {
            let half = if parallel { 5.0 } else { 4.5 };
            let camera = Camera::look_at(
                from,
                DVec3::ZERO,
                DVec3::Z,
                convention.projection(half, from.length(), 0.5, 20.0),
                Viewport {
                    x: 16,
                    y: 32,
                    width: 200,
                    height: 200,
                },
            )
            .expect("a camera");
            let cameras = [camera];
            let map = DepthMap::draw(lab.gpu, &scene, &cameras, 240, format);
            let light = if parallel {
                Light::Directional {
                    direction: -from,
                    irradiance: [1.0; 3],
                }
            } else {
                point(from, [20.0; 3])
            };
            let shaded = |shadow| ShadedLight { light, shadow };
            let shadow = Shadow::Map(ShadowMap {
                bias,
                ..ShadowMap::new(&map.texture, &cameras)
            });
            let with = lab.shade(&lit, &grey, &[shaded(shadow)], 1);
            let without = lab.shade(&lit, &grey, &[shaded(Shadow::None)], 1);
            let inputs = format!("{convention:?} {format:?} bias {bias}");
            let (mut dark, mut wrong) = (0, 0);
            for ((surfel, with), without) in lit.surfels.iter().zip(&with).zip(&without) {
                // Where the ray to the light passes the blocker's plane, in units of its half side.
                let p = surfel.position;
                let to_light = if parallel { from } else { from - p };
                let crossing =
                    p + to_light * ((2.0 - p.y) / to_light.y) - DVec3::new(0.2, 2.0, 0.0);
                let inside = crossing.x.abs().max(crossing.z.abs()) / 0.5;
                // The edge is known to a texel, and the bias moves it by another: 0.1 of the half side.
                if p.y < 1.0 && (inside - 1.0).abs() < 0.2 {
                    continue;
                }
                let shadowed = p.y < 1.0 && inside < 1.0;
                let expected = if shadowed {
                    SurfelRadiance::default()
                } else {
                    *without
                };
                dark += usize::from(shadowed);
                wrong += usize::from(*with != expected);
            }
            println!(
                "{inputs}: {dark} in shadow, {wrong} wrong of {}",
                with.len()
            );
            assert!(dark > 30, "{inputs}: {dark} in shadow");
            if bias > 0.0 {
                assert_eq!(wrong, 0, "{inputs}");
            } else {
                // What the bias is for: a slanted plane lies partly behind its own texels.
                assert!(wrong > with.len() / 10, "{inputs}: {wrong} wrong");
            }
        }
    }
}

/// A point light's six maps leave no seams: in a cube all surfels are lit, off the middle and turned against the faces
/// too. What no map knows of is lit.
#[test]
fn maps_meet_without_seams() {
    let lab = Lab::new();
    let scene = quads(&room(2.0));
    let lit = lab.cloud(&scene, &above(1.0), &SurfelizerSettings::default());
    let grey = [material(ALBEDO, [0.0; 3])];
    for eye in [DVec3::ZERO, DVec3::new(0.3, -1.2, 0.9)] {
        // Next to the room's edges a texel can hold the depth of the other wall, nearer by any amount where the light
        // grazes that: a strip of less than a texel.
        for (size, accepted) in [(64, 0.005), (256, 0.0)] {
            let cameras = cube(eye, size, 0.01);
            let format = wgpu::TextureFormat::Depth32Float;
            let map = DepthMap::draw(lab.gpu, &scene, &cameras, size, format);
            let by = |shadow| {
                let light = point(eye, [1.0; 3]);
                lab.shade(&lit, &grey, &[ShadedLight { light, shadow }], 4)
            };
            let whole = by(Shadow::None);
            let found = by(Shadow::Map(ShadowMap::new(&map.texture, &cameras)));
            assert!(whole.iter().all(|r| r.front[0] > 0.0), "{eye} {size}");
            let dark = found.iter().zip(&whole).filter(|(a, b)| a != b).count();
            println!("{eye} {size} texels: {dark} of {}", whole.len());
            let accepted = (accepted * whole.len() as f64) as usize;
            assert!(dark <= accepted, "{eye} {size}: {dark}");
        }
    }

    // Nor do they let light out of a closed box: what lies between two maps would count as lit.
    let closed = quads(&[room(2.0), room(0.5)].concat());
    for eye in [DVec3::ZERO, DVec3::new(0.1, -0.3, 0.2)] {
        let cameras = cube(eye, 64, 0.01);
        let format = wgpu::TextureFormat::Depth32Float;
        let map = DepthMap::draw(lab.gpu, &closed, &cameras, 64, format);
        let shaded = ShadedLight {
            light: point(eye, [1.0; 3]),
            shadow: Shadow::Map(ShadowMap::new(&map.texture, &cameras)),
        };
        let found = lab.shade(&lit, &grey, &[shaded], 4);
        let lit = found.iter().filter(|r| r.front != [0.0; 3]).count();
        assert_eq!(lit, 0, "{eye}: {lit} of {}", found.len());
    }

    // A near plane beyond the walls.
    let blind = [Camera::look_at(
        DVec3::ZERO,
        DVec3::X,
        DVec3::Y,
        Convention::Forward.projection(1.0, 1.0, 1e4, 1e5),
        Viewport::full(64, 64),
    )
    .expect("a camera")];
    let format = wgpu::TextureFormat::Depth32Float;
    let map = DepthMap::draw(lab.gpu, &scene, &blind, 64, format);
    let by = |shadow| {
        let light = point(DVec3::ZERO, [1.0; 3]);
        lab.shade(&lit, &grey, &[ShadedLight { light, shadow }], 1)
    };
    let map = Shadow::Map(ShadowMap::new(&map.texture, &blind));
    assert_eq!(by(map), by(Shadow::None));
}

/// Shadow maps against traced shadows, in a room with furniture: what differs lies at the edges of shadows, and becomes
/// less with the size of a texel.
#[test]
fn maps_come_near_traced_shadows() {
    let lab = Lab::new();
    let scene = scenes::closed_room();
    let camera = camera_of(&scene, 0, [64, 64]);
    let materials = scene.material_table();
    let lit = lab.cloud(&scene, &camera, &SurfelizerSettings::default());
    let tracer = Tracer::new(&scene.positions, &scene.indices).expect("a scene");
    let eye = DVec3::from(scene.views[0].eye);
    let light = point(eye, [1.0; 3]);
    for (size, accepted) in [(64, 0.025), (512, 0.005)] {
        let cameras = cube(eye, size, 0.01);
        let format = wgpu::TextureFormat::Depth32Float;
        let map = DepthMap::draw(lab.gpu, &scene, &cameras, size, format);
        let shadow = Shadow::Map(ShadowMap::new(&map.texture, &cameras));
        let found = lab.shade(&lit, &materials, &[ShadedLight { light, shadow }], 1);
        let mut wrong = 0;
        for (surfel, found) in lit.surfels.iter().zip(&found) {
            let material = materials[surfel.material as usize];
            let sides = [
                (surfel.normal, found.front, color(material.emission) / PI),
                (-surfel.normal, found.back, DVec3::ZERO),
            ];
            wrong += usize::from(sides.into_iter().any(|(normal, found, emission)| {
                let direct =
                    tracer.direct(surfel.position, normal, color(material.albedo), &[light]);
                let off = (color(found) - emission - direct).abs().max_element();
                off > 1e-4 * (direct + emission).max_element() + 1e-7
            }));
        }
        println!("{size} texels: {wrong} of {} differ", found.len());
        let accepted = (accepted * found.len() as f64) as usize;
        assert!(wrong <= accepted, "{size}: {wrong} of {}", found.len());
    }
}
