//! The camera by itself, on the CPU.

use deep_screen_space::{
    Camera, Viewport,
    glam::{
        DVec3,
        dcamera::rh::{proj::directx as right, view::look_at_mat4},
    },
};

use super::harness::{SIZES, cases, random};

/// Columns of plain arrays are those of the matrices.
#[test]
fn arrays_are_matrices() {
    let view = look_at_mat4(DVec3::new(1.0, 2.0, 3.0), DVec3::ZERO, DVec3::Y);
    let projection = right::perspective_infinite_reverse(1.0, 1.5, 0.1);
    let viewport = Viewport::full(12, 8);
    let arrays = [view, projection].map(|m| m.to_cols_array_2d());
    assert_eq!(
        Camera::from_arrays(arrays[0], arrays[1], viewport),
        Camera::new(view, projection, viewport)
    );
    let singles = [view, projection].map(|m| m.as_mat4());
    let of_singles = singles.map(|m| m.to_cols_array_2d());
    assert_eq!(
        Camera::from_arrays(of_singles[0], of_singles[1], viewport),
        Camera::new(singles[0].as_dmat4(), singles[1].as_dmat4(), viewport)
    );
    let flat = [[0.0; 4]; 4];
    assert!(matches!(
        Camera::from_arrays(arrays[0], flat, viewport),
        Err(deep_screen_space::Error::Camera { .. })
    ));
}

#[test]
fn project_and_unproject_are_each_others_inverse() {
    for case in cases() {
        for size in SIZES {
            let camera = case.camera(size);
            for i in 0..200 {
                let x = random(i, 10) * f64::from(size[0]);
                let y = random(i, 11) * f64::from(size[1]);
                let point = case.point(&camera, x, y, case.distance(i));
                let inputs = format!("{}, {size:?}, pixel {x} {y}, point {point}", case.name);
                let pixel = camera.project(point).expect(&inputs);
                assert!(
                    (pixel.x - x).abs().max((pixel.y - y).abs())
                        < 1e-8 * f64::from(size[0].max(size[1])),
                    "{inputs}: projects to {pixel}"
                );
                assert!(
                    (0.0..=1.0).contains(&pixel.z),
                    "{inputs}: depth {}",
                    pixel.z
                );
                let back = camera.unproject(x, y, pixel.z).expect(&inputs);
                // Forward depth of a far point has lost far/near of its 2^-53.
                let lost = case.distances[1] / case.distances[0] * 1e-15;
                assert!(
                    back.distance(point) <= (1e-11 + lost) * point.length(),
                    "{inputs}: comes back as {back}"
                );
            }
            let background = f64::from(camera.background_depth());
            assert_eq!(
                camera.unproject(0.5, 0.5, background),
                None,
                "{}",
                case.name
            );
            assert_eq!(camera.unproject(0.5, 0.5, f64::NAN), None, "{}", case.name);
            // Nearer is on the other side of the range.
            let depth = |i| {
                let distance = case.distances[i];
                camera
                    .project(case.point(&camera, 0.5, 0.5, distance))
                    .expect(case.name)
                    .z
            };
            assert!(
                (depth(0) - background).abs() > (depth(1) - background).abs(),
                "{}: depth {} near, {} far, background {background}",
                case.name,
                depth(0),
                depth(1)
            );
        }
    }
}

#[test]
fn a_pixel_is_as_large_as_its_neighbours_are_apart() {
    for case in cases() {
        let camera = case.camera([127, 89]);
        let footprint = camera.footprint();
        let distance = case.distance(1);
        // About the axis, where the distance along it is the Euclidean one.
        let axis = camera
            .project(
                camera.rotation().transpose()
                    * DVec3::Z
                    * if case.left_handed {
                        distance
                    } else {
                        -distance
                    },
            )
            .expect(case.name);
        let at = |x, y| case.point(&camera, axis.x + x, axis.y + y, distance);
        let measured =
            (at(0.5, 0.0).distance(at(-0.5, 0.0)) * at(0.0, 0.5).distance(at(0.0, -0.5))).sqrt();
        let given = footprint.at(at(0.0, 0.0));
        assert!(
            (given / measured - 1.0).abs() < 1e-3,
            "{}: {given}, measured {measured}",
            case.name
        );
    }
}
