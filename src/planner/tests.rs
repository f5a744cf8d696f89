use wgpu::TextureFormat;

use super::*;
use crate::{HitResolverSettings, RayTracedViewDescriptor, instanced_bvh::INSTANCE_BYTES};

const RADIUS: RayTracedEffect = RayTracedEffect::AmbientOcclusion { radius: 2.0 };
const LIGHT: RayTracedEffect = RayTracedEffect::IndirectDiffuse {
    sky_radiance: [0.0; 3],
};

/// Each effect.
const EFFECTS: [RayTracedEffect; 5] = [
    RADIUS,
    RayTracedEffect::DirectionalOcclusion { radius: 2.0 },
    RayTracedEffect::BentNormals { radius: 2.0 },
    LIGHT,
    RayTracedEffect::IndirectSpecular {
        sky_radiance: [0.0; 3],
    },
];

/// Of each effect, and of occlusion with and without a radius.
const CURVES: [curves::Curves; 6] = [
    curves::WITHIN_RADIUS,
    curves::UNBOUNDED,
    curves::SKY,
    curves::BENT,
    curves::LIGHT,
    curves::GLOSSY,
];

fn calibration() -> Calibration {
    let method = |scene_ms, low, high, difference| {
        Some(MethodCalibration {
            scene_ms,
            view_ms: [low, high],
            difference: Some(difference),
            errors: None,
        })
    };
    Calibration {
        size: [1000, 500],
        triangles: 100_000,
        rays: method(4.0, 2.0, 14.0, 0.03),
        splats: method(1.0, 1.0, 9.0, 0.08),
        obscurance: method(0.0, 0.2, 0.6, 0.15),
    }
}

fn planned(effect: RayTracedEffect, budget: Budget, calibration: Option<&Calibration>) -> Plan {
    plan(&PlanRequest {
        limits: &Limits::default(),
        size: [1000, 500],
        scene: SceneCounts::once(100_000),
        effect,
        budget,
        calibration,
    })
    .expect("a plan")
}

#[test]
fn an_error_is_met_by_the_cheapest_that_does() {
    let calibration = calibration();
    for effect in EFFECTS {
        for error in [0.5, 0.2, 0.1, 0.05, 0.03] {
            let plan = planned(effect, Budget::Error(error), Some(&calibration));
            let meets = |c: &&Candidate| c.error * MARGIN <= error && c.milliseconds.is_some();
            let cheapest = plan.weighed.iter().filter(meets).min_by(|a, b| {
                let time = |c: &Candidate| c.milliseconds.unwrap_or(f64::INFINITY);
                time(a).total_cmp(&time(b))
            });
            if let Some(cheapest) = cheapest {
                assert_eq!(&plan.chosen, cheapest, "{error}\n{plan}");
            } else {
                let nearest = plan.chosen.error;
                assert!(
                    plan.weighed.iter().all(|c| c.error >= nearest),
                    "{error}\n{plan}"
                );
                assert_eq!(plan.misses_by.is_some(), nearest > error, "{error}\n{plan}");
            }
        }
    }
}

#[test]
fn a_time_is_met_by_the_most_exact_that_does() {
    let calibration = calibration();
    let plan = |time| planned(RADIUS, Budget::Milliseconds(time), Some(&calibration));
    // The cheapest rays take 5.4 ms, of which the scene's recording is 4.
    assert_eq!(plan(5.0).chosen.method.kind(), MethodKind::Splats);
    assert_eq!(plan(1.0).chosen.method.kind(), MethodKind::Obscurance);
    let rays = plan(12.0);
    assert_eq!(rays.chosen.method.kind(), MethodKind::Rays);
    assert!(rays.chosen.milliseconds.is_some_and(|time| time <= 12.0));
    let missed = plan(0.1);
    assert_eq!(
        missed.misses_by,
        missed.chosen.milliseconds.map(|time| time / 0.1)
    );
    assert!(missed.to_string().contains("missed by a factor of"));
}

#[test]
fn calibrated_rungs_are_predicted_as_they_were_measured() {
    let calibration = calibration();
    for effect in EFFECTS {
        let plan = planned(effect, Budget::Error(1.0), Some(&calibration));
        for kind in MethodKind::ALL {
            let (Some(rungs), Some(known)) = (kind.calibrated(&effect), calibration.of(kind))
            else {
                continue;
            };
            for (rung, ms) in rungs.iter().zip(known.view_ms) {
                let found = plan.weighed.iter().find(|c| c.method == *rung);
                let found = found.and_then(|c| c.milliseconds).expect("it was weighed");
                let measured = ms + known.scene_ms;
                assert!(
                    (found - measured).abs() < 1e-9,
                    "{rung}: {found} for {measured}"
                );
            }
        }
    }
}

#[test]
fn qualities_are_rays_as_they_are_set() {
    for effect in EFFECTS {
        let mut errors = Vec::new();
        for quality in Quality::ALL {
            let plan = planned(effect, Budget::Quality(quality), None);
            let view = RayTracedViewDescriptor::new(effect, quality, TextureFormat::Rgba16Float);
            assert_eq!(plan.chosen.method, Method::Rays(view.rays));
            assert_eq!(plan.chosen.milliseconds, None);
            errors.push(plan.chosen.error);
        }
        assert!(errors.is_sorted_by(|a, b| a > b), "{effect:?}: {errors:?}");
    }
}

/// Each rung of rays has as many as it says, and the filter of its effect.
#[test]
fn rays_are_as_their_effect_needs_them() {
    for effect in EFFECTS {
        let rungs = MethodKind::Rays.rungs(&effect);
        let few = curves::RAYS.len() - rungs.len();
        for (rung, &all) in rungs.iter().zip(&curves::RAYS[few..]) {
            let Method::Rays(rays) = rung else {
                panic!("{rung} is no number of rays");
            };
            assert_eq!(rays.all_rays(), f64::from(all));
            let expected = match effect {
                RayTracedEffect::AmbientOcclusion { .. } => HitResolverSettings::for_occlusion(all),
                RayTracedEffect::DirectionalOcclusion { .. } => {
                    HitResolverSettings::for_environment(all)
                }
                RayTracedEffect::BentNormals { .. } => HitResolverSettings::for_bent_normals(all),
                RayTracedEffect::IndirectDiffuse { .. } => HitResolverSettings::for_light(all),
                RayTracedEffect::IndirectSpecular { .. } => {
                    HitResolverSettings::for_glossy_light(all)
                }
            };
            assert_eq!(rays.filter, expected, "{effect:?}, {all}");
        }
    }
}

/// Methods that an effect does not have are not weighed, and those that it has are, with what they keep per pixel.
#[test]
fn methods_are_those_of_the_effect() {
    let calibration = calibration();
    let weighed = |effect| planned(effect, Budget::Error(0.1), Some(&calibration)).weighed;
    let kinds = |effect| {
        let mut kinds: Vec<_> = weighed(effect).iter().map(|c| c.method.kind()).collect();
        kinds.dedup();
        kinds
    };
    assert_eq!(kinds(RADIUS), MethodKind::ALL);
    assert_eq!(kinds(LIGHT), [MethodKind::Rays]);
    for effect in [EFFECTS[1], EFFECTS[2], EFFECTS[4]] {
        assert_eq!(kinds(effect), [MethodKind::Rays, MethodKind::Splats]);
        // A view's levels of four channels for one.
        let splats = |effect| {
            let all = weighed(effect);
            let found = all.iter().find(|c| c.method.kind() == MethodKind::Splats);
            found.map(|c| c.memory_bytes).expect("splats are weighed")
        };
        let more = splats(effect) - splats(RADIUS);
        assert!(more >= 500_000 * 5 * 2 * (16 - 4), "{effect:?}: {more}");
    }
}

#[test]
fn more_triangles_than_fit_become_instances_or_are_refused() {
    let request = |scene| {
        plan(&PlanRequest {
            limits: &Limits::default(),
            size: [640, 480],
            scene,
            effect: RADIUS,
            budget: Budget::Error(0.01),
            calibration: None,
        })
    };
    assert_eq!(
        request(SceneCounts::once(2_000_000)).map(|p| p.primitives),
        Ok(Primitives::Triangles)
    );
    let forest = SceneCounts {
        triangles: 10_000_000,
        mesh_triangles: 10_000,
        instances: 1000,
    };
    let plan = request(forest).expect("a plan");
    assert_eq!(plan.primitives, Primitives::Instances);
    assert_eq!(plan.chosen.method.kind(), MethodKind::Rays);
    assert!(plan.chosen.memory_bytes < 50_000_000, "{plan}");
    // The depth buffer does not care.
    let many = request(SceneCounts::once(1 << 30)).expect("a plan");
    assert_eq!(many.chosen.method.kind(), MethodKind::Obscurance);
    let light = PlanRequest {
        limits: &Limits::default(),
        size: [640, 480],
        scene: SceneCounts::once(1 << 30),
        effect: LIGHT,
        budget: Budget::Error(0.01),
        calibration: None,
    };
    assert!(matches!(super::plan(&light), Err(Error::Limit { .. })));
}

#[test]
fn what_cannot_be_planned_for_is_a_typed_error() {
    let limits = Limits::default();
    let request = |size, budget, calibration| {
        plan(&PlanRequest {
            limits: &limits,
            size,
            scene: SceneCounts::once(1000),
            effect: RADIUS,
            budget,
            calibration,
        })
        .expect_err("refused")
        .to_string()
    };
    let error = Budget::Error(0.1);
    assert!(request([0, 10], error, None).contains("PlanRequest::size"));
    for bad in [0.0, -1.0, f64::NAN] {
        assert!(request([10, 10], Budget::Error(bad), None).contains("Budget::Error"));
        assert!(
            request([10, 10], Budget::Milliseconds(bad), None).contains("Budget::Milliseconds")
        );
    }
    assert!(request([10, 10], Budget::Milliseconds(1.0), None).contains("only with a calibration"));
    let broken = Calibration {
        triangles: 0,
        ..calibration()
    };
    assert!(request([10, 10], error, Some(&broken)).contains("Calibration::triangles"));
    let mut broken = calibration();
    broken.rays = Some(MethodCalibration {
        scene_ms: f64::NAN,
        view_ms: [1.0, 2.0],
        difference: None,
        errors: None,
    });
    assert!(request([10, 10], error, Some(&broken)).contains("MethodCalibration::scene_ms"));
    let broken = [[-1.0, 0.1], [0.1, f64::NAN], [f64::INFINITY, 0.1]].map(|errors| {
        let mut broken = calibration();
        broken.rays = broken.rays.map(|rays| MethodCalibration {
            errors: Some(errors),
            ..rays
        });
        broken
    });
    for broken in &broken {
        assert!(request([10, 10], error, Some(broken)).contains("MethodCalibration::errors"));
    }
}

/// Neither counts nor sizes are too large to plan for.
#[test]
fn the_largest_counts_are_planned_for() {
    let request = |effect, scene| {
        plan(&PlanRequest {
            limits: &Limits::default(),
            size: [8192; 2],
            scene,
            effect,
            budget: Budget::Error(0.1),
            calibration: Some(&calibration()),
        })
    };
    let all = SceneCounts {
        triangles: u64::MAX,
        mesh_triangles: u64::MAX,
        instances: u64::MAX,
    };
    let found = request(RADIUS, all).expect("the depth buffer does not care");
    assert_eq!(found.chosen.method.kind(), MethodKind::Obscurance);
    assert!(found.weighed.iter().all(|c| c.error.is_finite()));
    assert!(matches!(request(LIGHT, all), Err(Error::Limit { .. })));
    let none = SceneCounts::once(0);
    assert!(request(LIGHT, none).is_ok_and(|plan| plan.chosen.milliseconds.is_some()));
    for effect in EFFECTS {
        assert!(request(effect, none).is_ok(), "{effect:?}");
    }
}

/// Why there is no plan is said in the figures of what there is too much of.
#[test]
fn what_has_no_room_is_named() {
    let request = |effect, size, scene, budget| {
        let plan = plan(&PlanRequest {
            limits: &Limits::default(),
            size,
            scene,
            effect,
            budget,
            calibration: None,
        });
        plan.map(|plan| plan.misses_by)
    };
    let binding = |needed, why| {
        Err(Error::Limit {
            limit: "max_storage_buffer_binding_size",
            available: 128 << 20,
            needed,
            why,
        })
    };
    let balanced = Budget::Quality(Quality::Balanced);
    let few = SceneCounts::once(1000);
    let texture = Err(Error::Limit {
        limit: "max_texture_dimension_2d",
        available: 8192,
        needed: 8193,
        why: "PlanRequest::size",
    });
    assert_eq!(request(RADIUS, [1, 8193], few, balanced), texture);
    // 16 bytes a pixel, and 32 of glossy ones.
    let glossy = RayTracedEffect::IndirectSpecular {
        sky_radiance: [0.0; 3],
    };
    let counted = "rays of pixels, where further ones go to some";
    assert_eq!(request(LIGHT, [4096, 2048], few, balanced), Ok(None));
    let found = request(LIGHT, [4097, 2048], few, balanced);
    assert_eq!(found, binding(16 * 4097 * 2048, counted));
    let found = request(glossy, [2049, 2048], few, balanced);
    assert_eq!(found, binding(32 * 2049 * 2048, counted));
    // Rays that are the same at each pixel have room.
    let any = request(LIGHT, [8192, 8192], few, Budget::Error(1e-6));
    assert!(any.is_ok_and(|misses| misses.is_some()));
    let meshes = SceneCounts {
        triangles: 5_000_000_000,
        mesh_triangles: 1000,
        instances: 5_000_000,
    };
    let found = request(LIGHT, [64, 64], meshes, balanced);
    assert_eq!(found, binding(5_000_000 * INSTANCE_BYTES, "instances"));
}

#[test]
fn radii_out_of_range_are_refused() {
    for radius in [f32::NAN, -1.0] {
        for (effect, field) in [
            (
                RayTracedEffect::AmbientOcclusion { radius },
                "RayTracedEffect::AmbientOcclusion::radius",
            ),
            (
                RayTracedEffect::DirectionalOcclusion { radius },
                "RayTracedEffect::DirectionalOcclusion::radius",
            ),
            (
                RayTracedEffect::BentNormals { radius },
                "RayTracedEffect::BentNormals::radius",
            ),
        ] {
            let refused = plan(&PlanRequest {
                limits: &Limits::default(),
                size: [64, 64],
                scene: SceneCounts::once(10),
                effect,
                budget: Budget::Error(0.1),
                calibration: None,
            });
            assert!(
                refused.is_err_and(|e| e.to_string().contains(field)),
                "{effect:?}"
            );
        }
    }
}

#[test]
fn curves_run_through_their_rungs() {
    for curves in CURVES {
        let few = curves::RAYS.len() - curves.rays.errors.len();
        let works: Vec<f64> = curves::RAYS[few..]
            .iter()
            .map(|&rays| f64::from(rays))
            .collect();
        for (work, error) in works.iter().zip(curves.rays.errors) {
            assert!((curves.rays.at(&works, *work) - error).abs() < 1e-12);
        }
        let [left, right] = [3, 4].map(|i| curves.rays.errors[i - few]);
        let between = curves.rays.at(&works, 128.0_f64.sqrt());
        assert!((between - (left * right).sqrt()).abs() < 1e-12);
        assert_eq!(curves.rays.errors[2 - few], 1.0, "a calibration's own rung");
    }
}

/// Measured errors are what is predicted of the calibrated rungs, and other rungs of rays lie where the curve has them.
#[test]
fn measured_errors_are_met() {
    let mut calibration = calibration();
    let errors = [0.3, 0.05];
    for method in [&mut calibration.rays, &mut calibration.splats] {
        *method = method.map(|known| MethodCalibration {
            errors: Some(errors),
            ..known
        });
    }
    for effect in EFFECTS {
        let plan = planned(effect, Budget::Error(1.0), Some(&calibration));
        for kind in [MethodKind::Rays, MethodKind::Splats] {
            let of_kind = plan.weighed.iter().filter(|c| c.method.kind() == kind);
            let weighed: Vec<_> = of_kind.collect();
            for (rung, error) in kind.calibrated(&effect).into_iter().flatten().zip(errors) {
                let found = weighed.iter().find(|c| c.method == rung).map(|c| c.error);
                let found = found.expect("it was weighed");
                assert!((found - error).abs() < 1e-9, "{rung}: {found} for {error}");
            }
            assert!(
                weighed.is_sorted_by(|a, b| a.error >= b.error),
                "{effect:?}\n{plan}"
            );
        }
    }
    // Nothing is seen to vary: no error is a number.
    calibration.rays = calibration.rays.map(|rays| MethodCalibration {
        errors: Some([0.0; 2]),
        ..rays
    });
    let plan = planned(EFFECTS[1], Budget::Error(0.1), Some(&calibration));
    assert!(plan.weighed.iter().all(|c| c.error.is_finite()), "{plan}");
}

#[test]
fn curves_fall() {
    for curves in CURVES {
        for kind in MethodKind::ALL {
            let Some(curve) = curves.of(kind) else {
                continue;
            };
            assert!(curve.errors.is_sorted_by(|a, b| a > b), "{curve:?}");
        }
    }
}
