//! A box after the Cornell box: 5.5 m wide, high and deep, open toward +Z, 32 triangles.
//!
//! It tests colour bleeding from the red and the green wall, contact shadows at the two blocks,
//! and light from an emitter that is often outside the image. The triangles are few and large, as
//! far as can be from the evenly small ones that surfels like.

use glam::{DAffine3, DQuat, DVec3};

use super::builder::{Base, Builder, MaterialId};
use super::{Scene, View};

pub(super) const NAME: &str = "cornell";

/// Half the width and the depth of the room, in metres.
const HALF: f64 = 2.75;
const HEIGHT: f64 = 5.5;

/// Builds the Cornell-like box.
pub fn cornell() -> Scene {
    let mut builder = Builder::default();
    // Albedos near those measured at Cornell, averaged to linear RGB.
    let white = builder.surface([0.73, 0.73, 0.73]);
    let red = builder.surface([0.63, 0.06, 0.05]);
    let green = builder.surface([0.14, 0.45, 0.09]);
    let lamp = builder.material([0.78, 0.78, 0.78], [53.0, 37.0, 12.0]);

    walls(&mut builder, white, red, green);
    lamp_panel(&mut builder, lamp);
    block(
        &mut builder,
        white,
        DVec3::new(0.95, 0.0, 0.95),
        1.65,
        1.65,
        -17.0,
    );
    block(
        &mut builder,
        white,
        DVec3::new(-0.9, 0.0, -0.8),
        1.65,
        3.3,
        18.0,
    );

    let views = vec![
        View {
            name: "front",
            eye: [0.0, 2.75, 10.75],
            target: [0.0, 2.75, 0.0],
            up: [0.0, 1.0, 0.0],
            vertical_fov_degrees: 39.0,
            near: 0.1,
        },
        View {
            name: "between-blocks",
            eye: [-0.6, 0.7, 1.6],
            target: [0.1, 0.3, -0.4],
            up: [0.0, 1.0, 0.0],
            vertical_fov_degrees: 60.0,
            near: 0.02,
        },
    ];
    builder.finish(NAME, views, 1.5)
}

fn walls(builder: &mut Builder, white: MaterialId, red: MaterialId, green: MaterialId) {
    let at = |x: f64, y: f64, z: f64| DVec3::new(x * HALF, y * HEIGHT, z * HALF);
    let floor = [
        at(-1.0, 0.0, 1.0),
        at(1.0, 0.0, 1.0),
        at(1.0, 0.0, -1.0),
        at(-1.0, 0.0, -1.0),
    ];
    let ceiling = [
        at(-1.0, 1.0, -1.0),
        at(1.0, 1.0, -1.0),
        at(1.0, 1.0, 1.0),
        at(-1.0, 1.0, 1.0),
    ];
    let back = [
        at(-1.0, 0.0, -1.0),
        at(1.0, 0.0, -1.0),
        at(1.0, 1.0, -1.0),
        at(-1.0, 1.0, -1.0),
    ];
    let left = [
        at(-1.0, 0.0, 1.0),
        at(-1.0, 0.0, -1.0),
        at(-1.0, 1.0, -1.0),
        at(-1.0, 1.0, 1.0),
    ];
    let right = [
        at(1.0, 0.0, -1.0),
        at(1.0, 0.0, 1.0),
        at(1.0, 1.0, 1.0),
        at(1.0, 1.0, -1.0),
    ];
    for corners in [floor, ceiling, back] {
        builder.quad(white, corners);
    }
    builder.quad(red, left);
    builder.quad(green, right);
}

/// A panel 1.3 m by 1.05 m, facing down.
fn lamp_panel(builder: &mut Builder, lamp: MaterialId) {
    let half = DVec3::new(0.65, 0.0, 0.525);
    // A centimetre below the ceiling: clear of it at the depth precision of any view here.
    let centre = DVec3::new(0.0, HEIGHT - 0.01, 0.0);
    let at = |x: f64, z: f64| centre + half * DVec3::new(x, 0.0, z);
    builder.quad(
        lamp,
        [at(-1.0, -1.0), at(1.0, -1.0), at(1.0, 1.0), at(-1.0, 1.0)],
    );
}

/// A block on the floor, turned about the vertical.
fn block(
    builder: &mut Builder,
    material: MaterialId,
    foot: DVec3,
    width: f64,
    height: f64,
    turn_degrees: f64,
) {
    let half = DVec3::new(width, height, width) / 2.0;
    let turn = DQuat::from_rotation_y(turn_degrees.to_radians());
    let pose = DAffine3::from_rotation_translation(turn, foot + DVec3::Y * half.y);
    builder.block(material, pose, half, Base::Open);
}
