use super::*;

const RADIUS: RayTracedEffect = RayTracedEffect::AmbientOcclusion { radius: 2.0 };
const LIGHT: RayTracedEffect = RayTracedEffect::IndirectDiffuse {
    sky_radiance: [0.0; 3],
};

fn calibration() -> Calibration {
    let method = |scene_ms, low, high, difference| {
        Some(MethodCalibration {
            scene_ms,
            view_ms: [low, high],
            difference: Some(difference),
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
    for effect in [RADIUS, LIGHT] {
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
    for effect in [RADIUS, LIGHT] {
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
    for quality in Quality::ALL {
        let plan = planned(LIGHT, Budget::Quality(quality), None);
        let expected = quality.rays(LIGHT.payload());
        assert_eq!(plan.chosen.method, Method::Rays(expected));
        assert_eq!(plan.chosen.milliseconds, None);
        assert!(plan.chosen.error > 0.0);
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
    });
    assert!(request([10, 10], error, Some(&broken)).contains("MethodCalibration::scene_ms"));
}

/// Neither counts nor sizes are too large to plan for.
#[test]
fn the_largest_counts_are_planned_for() {
    let request = |effect, scene| {
        plan(&PlanRequest {
            limits: &Limits::default(),
            size: [u32::MAX; 2],
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
    for effect in [
        RayTracedEffect::AmbientOcclusion { radius: f32::NAN },
        RayTracedEffect::AmbientOcclusion { radius: -1.0 },
        RayTracedEffect::BentNormals { radius: 1.0 },
        RayTracedEffect::DirectionalOcclusion { radius: 1.0 },
        RayTracedEffect::IndirectSpecular {
            sky_radiance: [0.0; 3],
        },
    ] {
        let refused = request(effect, none);
        assert!(matches!(refused, Err(Error::Setting { .. })), "{effect:?}");
    }
}

#[test]
fn curves_run_through_their_rungs() {
    for curves in [curves::WITHIN_RADIUS, curves::UNBOUNDED, curves::LIGHT] {
        let works = curves::RAYS.map(f64::from);
        for (work, error) in works.iter().zip(curves.rays.errors) {
            assert!((curves.rays.at(&works, *work) - error).abs() < 1e-12);
        }
        let [left, right] = [curves.rays.errors[3], curves.rays.errors[4]];
        let between = curves.rays.at(&works, 128.0_f64.sqrt());
        assert!((between - (left * right).sqrt()).abs() < 1e-12);
        assert_eq!(curves.rays.errors[2], 1.0, "a calibration's own rung");
    }
}
