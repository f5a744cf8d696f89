//! A closed room, 6 m by 3 m by 5 m, with furniture and a lamp; the cameras stand inside.
//!
//! It tests that nothing leaks: with an unbounded radius no point inside sees the sky, so the
//! visibility is zero exactly, and whatever a method answers instead is its own error. The shell
//! is watertight: every edge belongs to two triangles, and no vertex lies on another's edge.

use glam::DVec3;

use super::builder::{Base, Builder, MaterialId};
use super::{Scene, View};

pub(super) const NAME: &str = "closed_room";

/// The shell's materials (walls, floor, ceiling) come first; furniture follows.
#[cfg(test)]
pub(super) const SHELL_MATERIALS: u32 = 3;

const LOW: DVec3 = DVec3::new(-3.0, 0.0, -2.5);
const SIZE: DVec3 = DVec3::new(6.0, 3.0, 5.0);
/// The shell's cells are a metre square, so that the cells of two walls meet at their corners.
const CELLS: [usize; 3] = [6, 3, 5];

/// Builds the closed room.
pub fn closed_room() -> Scene {
    let mut builder = Builder::default();
    let walls = builder.surface([0.7, 0.68, 0.6]);
    let floor = builder.surface([0.4, 0.25, 0.14]);
    let ceiling = builder.surface([0.8, 0.8, 0.8]);
    let wood = builder.surface([0.45, 0.28, 0.12]);
    let cloth = builder.surface([0.12, 0.22, 0.5]);
    let lamp = builder.material([0.7, 0.7, 0.7], [60.0, 55.0, 45.0]);

    shell(&mut builder, walls, floor, ceiling);
    table(&mut builder, wood);
    shelf(&mut builder, wood);
    sofa(&mut builder, cloth);
    builder.aligned_block(
        lamp,
        DVec3::new(-0.3, 2.6, -0.3),
        DVec3::new(0.3, 2.7, 0.3),
        Base::Closed,
    );

    let views = vec![
        View {
            name: "room",
            eye: [-2.6, 1.7, 2.2],
            target: [0.8, 0.8, -1.0],
            up: [0.0, 1.0, 0.0],
            vertical_fov_degrees: 65.0,
            near: 0.05,
        },
        View {
            name: "under-table",
            eye: [0.9, 0.35, 1.0],
            target: [0.2, 0.4, -0.3],
            up: [0.0, 1.0, 0.0],
            vertical_fov_degrees: 70.0,
            near: 0.02,
        },
    ];
    builder.finish(NAME, views, 1.5)
}

/// Six faces that look inward.
fn shell(builder: &mut Builder, walls: MaterialId, floor: MaterialId, ceiling: MaterialId) {
    let high = LOW + SIZE;
    let [x, y, z] = [DVec3::X * SIZE.x, DVec3::Y * SIZE.y, DVec3::Z * SIZE.z];
    let [nx, ny, nz] = CELLS;
    builder.grid(floor, LOW, z, x, [nz, nx]);
    builder.grid(ceiling, high, -x, -z, [nx, nz]);
    builder.grid(walls, LOW, x, y, [nx, ny]);
    builder.grid(walls, LOW, y, z, [ny, nz]);
    builder.grid(walls, high, -y, -x, [ny, nx]);
    builder.grid(walls, high, -z, -y, [nz, ny]);
}

fn table(builder: &mut Builder, wood: MaterialId) {
    let (half_x, half_z, top) = (0.8, 0.45, 0.75);
    builder.aligned_block(
        wood,
        DVec3::new(-half_x, top - 0.04, -half_z),
        DVec3::new(half_x, top, half_z),
        Base::Closed,
    );
    for (side_x, side_z) in [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)] {
        let foot = DVec3::new(side_x * (half_x - 0.08), 0.0, side_z * (half_z - 0.08));
        let half = DVec3::new(0.03, 0.0, 0.03);
        // A centimetre into the board.
        let head = foot + DVec3::Y * (top - 0.03);
        builder.aligned_block(wood, foot - half, head + half, Base::Open);
    }
}

/// Shelves between two uprights, a hand's breadth off the wall at -Z.
fn shelf(builder: &mut Builder, wood: MaterialId) {
    let (back, front) = (-2.4, -2.05);
    for x in [1.0, 2.5] {
        builder.aligned_block(
            wood,
            DVec3::new(x, 0.0, back),
            DVec3::new(x + 0.03, 2.0, front),
            Base::Open,
        );
    }
    for y in [0.1, 0.55, 1.0, 1.45, 1.9] {
        builder.aligned_block(
            wood,
            DVec3::new(1.02, y, back + 0.005),
            DVec3::new(2.51, y + 0.025, front - 0.005),
            Base::Closed,
        );
    }
}

/// A seat, a back and two arms, each overlapping the seat by 2 cm.
fn sofa(builder: &mut Builder, cloth: MaterialId) {
    let blocks = [
        ([-2.4, 0.0, -1.9], [-0.8, 0.42, -1.1]),
        ([-2.45, 0.0, -2.15], [-0.75, 0.85, -1.88]),
        ([-2.6, 0.0, -2.1], [-2.38, 0.6, -1.05]),
        ([-0.82, 0.0, -2.1], [-0.6, 0.6, -1.05]),
    ];
    for (low, high) in blocks {
        builder.aligned_block(cloth, DVec3::from(low), DVec3::from(high), Base::Open);
    }
}
