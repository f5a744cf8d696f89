//! Leaves of a piece, and colours in a word.

use deep_screen_space::{
    glam::DVec3,
    reference::{
        packing::{pack_color, unpack_color},
        surfelizer::{Triangle, leaf_at, leaf_of},
    },
};

/// Every leaf of a piece contains the points that are said to be in it.
#[test]
fn leaves_are_found() {
    let piece = Triangle {
        a: DVec3::new(0.1, 2.0, -3.0),
        b: DVec3::new(1.7, 1.1, -2.0),
        c: DVec3::new(0.4, 0.3, -1.2),
    };
    for order in [0, 1, 2, 5, 10] {
        for leaf in 0..1 << order {
            let t = leaf_of(piece, leaf, order);
            for share in [
                DVec3::splat(1.0 / 3.0),
                DVec3::new(0.9, 0.05, 0.05),
                DVec3::new(0.02, 0.9, 0.08),
            ] {
                let point = t.a * share.x + t.b * share.y + t.c * share.z;
                assert_eq!(leaf_at(piece, point, order), leaf, "order {order}, {share}");
            }
        }
    }
}

#[test]
fn colors_survive_packing() {
    for (color, tolerance) in [
        ([0.0; 3], 0.0),
        ([1.0, 0.5, 0.25], 0.0),
        ([1e18, 3e17, 1.0], 1.0 / 255.0),
        ([0.999_999, 0.1, 0.7], 1.0 / 255.0),
        ([255.5, 127.0, 3.0], 1.0 / 255.0),
        ([1e-20, 3e-20, 2e-21], 1.0 / 255.0),
        ([1e30; 3], 1.0 / 255.0),
    ] {
        let back = unpack_color(pack_color(color));
        let expected = DVec3::from(color.map(f64::from));
        let off = (back - expected).abs().max_element();
        let bound = tolerance * expected.max_element();
        assert!(off <= bound, "{color:?}: {back}");
    }
    assert_eq!(pack_color([f32::NAN, 0.0, 0.0]), 0);
    assert_eq!(pack_color([-1.0, -0.0, 0.0]), 0);
    assert_eq!(
        pack_color([f32::INFINITY, 0.0, 0.0]),
        pack_color([1e30, 0.0, 0.0])
    );
}
