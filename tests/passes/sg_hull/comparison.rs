//! Vertices and pixels, by GPU and by mirror.

use std::collections::{BTreeMap, BTreeSet};

use deep_screen_space::{
    Light, SgHullSettings, SgHullSize,
    glam::DVec3,
    reference::{
        packing::unpack_normal,
        sg_hull::{Corner, Fit, Hull, Part, gather_lights, is_flat, is_tiny, quad_error, shade},
        shell_splatter::Receiver,
    },
    scenes,
    spherical_gaussian::DLightMoments,
};

use support::testing::shot::{Shot, camera_of};

use super::harness::{LAB, Lab, SKY, lamps, record};

#[test]
fn vertices_and_pixels_are_those_of_the_mirror() {
    let Lab {
        gpu,
        gatherer,
        hull,
    } = &*LAB;
    let settings = SgHullSettings::default();
    // Light beside a wall leaves the rest dark: there the error is in units of the dimmest corner. Columns have it from their
    // normals.
    let beside = Light::Point {
        position: DVec3::new(-2.6, 2.7, 0.0),
        intensity: [1.0, 2.0, 3.0],
    };
    for (name, quad, error_threshold, lights) in [
        ("cornell", 4, 0.3, lamps()),
        ("cornell", 4, 0.3, vec![beside]),
        ("cornell", 16, 0.1, lamps()),
        ("fence", 4, 0.3, lamps()[2..].to_vec()),
        ("colonnade", 4, 0.06, lamps()),
    ] {
        let settings = SgHullSettings {
            quad,
            error_threshold,
            ..settings
        };
        let scene = scenes::by_name(name).expect("a scene");
        let shot = Shot::new(gpu, &scene, &camera_of(&scene, 0, [96, 64]));
        let eye = shot.camera.eye();
        let gather = gatherer
            .bind_lights(&gpu.device, &lights, eye)
            .expect("lights");
        let size = SgHullSize::new(96, 64);
        let recorded = record(gpu, hull, &shot, &gather, &settings, size);
        let receivers = shot.receivers(eye);
        let mirror = Hull {
            camera: &shot.camera,
            receivers: &receivers,
            settings: &settings,
        };
        let (mut off_vertices, mut off_pixels, mut vertices) = (0, 0, 0);
        let (mut gathered, mut sum) = (0_u32, 0.0);
        let mut corners = BTreeMap::new();
        let mut slots: BTreeSet<u32> = recorded.segment_of.iter().copied().collect();
        slots.remove(&SKY);
        let slot_of: BTreeMap<u32, u32> = slots.iter().map(|s| (recorded.index(*s), *s)).collect();
        let mut shared = 0;
        for slot in slots {
            let segment = recorded.segments[slot as usize];
            if is_tiny(&segment) {
                continue;
            }
            let list = [0, 1, 2, 3].map(|corner| {
                let own = recorded.vertices[(4 * recorded.index(slot) + corner) as usize];
                let place = |slot: u32, corner| {
                    let segment = recorded.segments[slot as usize];
                    mirror
                        .place(&segment, slot, &recorded.segment_of, corner)
                        .expect("a place")
                };
                // Light of a neighbour is that of the same point of the same surface, and gathered there.
                let found = recorded.vertices[own.owner as usize];
                assert_eq!(found.owner, own.owner, "{name}: {slot} {corner}");
                let owner = (slot_of[&(own.owner / 4)], own.owner % 4);
                if owner.0 != slot {
                    shared += 1;
                    let corner_of = |(slot, corner): (u32, u32)| {
                        let rect = recorded.segments[slot as usize].rect;
                        [
                            rect[(2 * (corner & 1)) as usize],
                            rect[(1 + (corner & 2)) as usize],
                        ]
                    };
                    assert_eq!(
                        corner_of(owner),
                        corner_of((slot, corner)),
                        "{name}: {slot}"
                    );
                    let [a, b] = [(slot, corner), owner].map(|(slot, corner)| {
                        let (position, normal) = place(slot, corner);
                        Receiver { position, normal }
                    });
                    assert!(mirror.similar(&a, &b, 1.03), "{name}: {slot}, {a:?}, {b:?}");
                }
                let (position, normal) = place(owner.0, owner.1);
                let lobes = gather_lights(&lights, position + eye, normal);
                if owner == (slot, corner) {
                    gathered += 1;
                    sum += lobes.irradiance.element_sum() / 3.0;
                }
                let excess = lobes.excess(normal);
                let total = lobes.moments.iter().fold(1e-6, |s, m| f64::max(s, m.total));
                let near = |a: DVec3, b: DVec3, tolerance: f64| a.distance(b) <= tolerance;
                let wide = |v: [f32; 3]| DVec3::from(v.map(f64::from));
                let red = DVec3::from([found.red[0], found.red[1], found.red[2]].map(f64::from));
                vertices += 1;
                // Normals are packed to 16 bits, positions known to 1e-6 of the distance: 1e-3 of the light is far beyond.
                if !(near(wide(found.position), position, 1e-3 * position.length())
                    && near(red, lobes.moments[0].vector, 2e-3 * total)
                    && near(wide(found.excess), excess, 2e-3 * total))
                {
                    off_vertices += 1;
                }
                let moments = |m: [f32; 4]| DLightMoments {
                    vector: DVec3::new(m[0].into(), m[1].into(), m[2].into()),
                    total: m[3].into(),
                };
                let found = Corner {
                    moments: [found.red, found.green, found.blue].map(moments),
                    excess: wide(found.excess),
                    depth: own.depth.into(),
                };
                let expected = found.irradiance(unpack_normal(segment.normal));
                assert!(
                    near(wide(own.irradiance), expected, 1e-3 * total),
                    "{name}: {slot} {corner}: {:?}, expected {expected}",
                    own.irradiance
                );
                found
            });
            corners.insert(slot, list);
        }
        // A quad's normals: a pixel is a texel here.
        let mut normals: BTreeMap<u32, Vec<DVec3>> = BTreeMap::new();
        for (slot, receiver) in recorded.segment_of.iter().zip(&receivers) {
            if let Some(receiver) = receiver {
                normals.entry(*slot).or_default().push(receiver.normal);
            }
        }
        for (slot, list) in &normals {
            let mean = list.iter().sum::<DVec3>() / list.len() as f64;
            let expected = (2.0 * (1.0 - mean.length())).max(0.0).sqrt();
            let found = f64::from(recorded.segments[*slot as usize].spread);
            // What the kernel takes off for rounding is 1.4e-3 where there is nothing else.
            assert!(
                (found - expected).abs() < 2e-3 + 0.02 * expected,
                "{name}: segment {slot} of {} pixels: {found}, expected {expected}",
                list.len()
            );
        }
        // Each vertex that light is gathered at counts, once.
        assert_eq!(recorded.counts.gathered, gathered, "{name}");
        let mean = f64::from(recorded.counts.mean_irradiance);
        let expected = sum / f64::from(gathered);
        assert!(
            (mean - expected).abs() < 2e-3 * expected,
            "{name}: mean {mean}, expected {expected}"
        );
        let (mut exact, mut flat, mut either, mut split) = (0_u32, 0, 0, 0_u32);
        for (i, (slot, pixel)) in recorded.segment_of.iter().zip(&recorded.pixels).enumerate() {
            let Some(receiver) = receivers[i].as_ref().filter(|_| *slot != SKY) else {
                continue;
            };
            let segment = recorded.segments[*slot as usize];
            let truth = || {
                gather_lights(&lights, receiver.position + eye, receiver.normal).irradiance
                    / std::f64::consts::PI
            };
            let found = DVec3::from([pixel[0], pixel[1], pixel[2]].map(f64::from));
            let list = corners.get(slot).filter(|_| *slot < recorded.size.segments);
            let Some(list) = list else {
                exact += 1;
                off_pixels += u32::from(found.distance(truth()) > 2e-3 * truth().length() + 1e-6);
                continue;
            };
            let at = [i as u32 % 96, i as u32 / 96];
            let hull = shade(&segment, list, at, receiver.normal);
            let scale = list
                .iter()
                .fold(1e-6, |s, c| f64::max(s, c.moments[1].total));
            let is = |expected: DVec3| found.distance(expected) <= 2e-3 * scale;
            let bound = f64::from(settings.error_threshold);
            let here = quad_error(&segment, list, mean);
            // Rounding moves what is close to the bound either way.
            let whole = Part::whole(&segment, list);
            let splits = is_flat(&segment) && whole.can_be_split();
            let near_bound = (here / bound - 1.0).abs() < 0.01;
            let right = if here < bound || near_bound {
                flat += i32::from(is_flat(&segment));
                is(hull)
            } else {
                false
            } || if !splits && (here >= bound || near_bound) {
                exact += u32::from(!near_bound);
                either += u32::from(near_bound);
                is(truth())
            } else {
                false
            } || if splits && (here >= bound || near_bound) {
                // Rounding moves what a part is, too: by more, since what is off is a difference of lights known to 1e-3.
                let found: Vec<Fit> = [0.95, 1.0, 1.05]
                    .iter()
                    .flat_map(|widened| {
                        let mut parts = Vec::new();
                        mirror
                            .split(
                                (&segment, *slot, &recorded.segment_of),
                                &whole,
                                (mean, bound * widened),
                                &|position, normal| {
                                    gather_lights(&lights, position + eye, normal).irradiance
                                },
                                &mut parts,
                            )
                            .expect("places");
                        parts.into_iter().filter(|(part, _)| part.contains(at))
                    })
                    .filter(|(part, fit)| match fit {
                        Fit::Quad => {
                            let middle = at.map(|x| f64::from(x) + 0.5);
                            is(part.shown(&shot.camera, middle) / std::f64::consts::PI)
                        }
                        Fit::Pixels => is(truth()),
                    })
                    .map(|(_, fit)| fit)
                    .collect();
                either += u32::from(found.contains(&Fit::Pixels));
                split += u32::from(found.contains(&Fit::Quad));
                !found.is_empty()
            } else {
                false
            };
            off_pixels += u32::from(!right);
        }
        println!(
            "{name}: {exact} pixels by themselves, {either} perhaps, {flat} of flat quads, {split} of parts"
        );
        assert!(
            exact > 20 && flat > 20 && (name != "cornell" || split > 100),
            "{name}"
        );
        assert!(
            (exact..=exact + either).contains(&recorded.counts.per_pixel),
            "{name}: {} of {exact} and {either}",
            recorded.counts.per_pixel
        );
        // Most of a flat wall's are.
        assert!(
            name != "cornell" || quad > 4 || 2 * shared > vertices,
            "{shared} of {vertices}"
        );
        println!(
            "{name}: {shared} shared, {off_vertices} of {vertices} vertices and {off_pixels} of {} pixels are off",
            recorded.pixels.len()
        );
        // A plane that is seen edge-on puts its corners where rounding has them.
        assert!(off_vertices * 100 <= vertices, "{name}");
        assert!(
            off_pixels as usize * 1000 <= recorded.pixels.len(),
            "{name}"
        );
    }
}
