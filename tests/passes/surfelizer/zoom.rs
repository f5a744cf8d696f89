//! Narrow views, whose surfels are far smaller than the triangles that they lie on: no area goes missing.

use deep_screen_space::{
    Camera, CloudCapacity, SurfelizerSettings, Viewport,
    glam::{DMat4, DVec3},
    reference::surfelizer as mirror,
};

use super::{
    comparison::assert_alike,
    harness::{Soup, Task, area, corners, disk_area, fixture},
};
use support::raster::perspective;

const SIZE: [u32; 2] = [72, 48];

/// A closed room 5 units a side, two triangles a wall, that no axis of the view is along.
fn room() -> Soup {
    let corner = |i: u32| {
        let bit = |b: u32| f64::from((i >> b) & 1) - 0.5;
        DMat4::from_rotation_y(0.3).transform_point3(5.0 * DVec3::new(bit(0), bit(1), bit(2)))
    };
    let walls = [
        [0, 1, 3, 2],
        [4, 6, 7, 5],
        [0, 4, 5, 1],
        [2, 3, 7, 6],
        [0, 2, 6, 4],
        [1, 5, 7, 3],
    ];
    let triangles: Vec<_> = walls
        .iter()
        .flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]])
        .map(|t| t.map(corner))
        .collect();
    Soup::of(&triangles)
}

fn camera(projection: DMat4) -> Camera {
    Camera::look_at(
        DVec3::new(1.3, 0.9, 1.7),
        DVec3::new(-0.2, -2.5, -0.1),
        DVec3::Y,
        projection,
        Viewport::full(SIZE[0], SIZE[1]),
    )
    .expect("a plain camera")
}

/// A camera that sees `half` up and down, wherever it stands.
fn orthographic(half: f64) -> DMat4 {
    let aspect = f64::from(SIZE[0]) / f64::from(SIZE[1]);
    DMat4::from_scale(DVec3::new(1.0 / (aspect * half), 1.0 / half, -0.05))
}

fn narrow_views() -> Vec<(String, Camera)> {
    let aspect = f64::from(SIZE[0]) / f64::from(SIZE[1]);
    let mut views = Vec::new();
    for degrees in [60.0, 1.0, 0.1, 0.03, 1e-3, 1e-5] {
        let name = format!("perspective of {degrees} degrees");
        views.push((name, camera(perspective(degrees, aspect, 0.01))));
    }
    for half in [2.5, 0.05, 5e-3, 5e-4, 1e-6] {
        let name = format!("orthographic of {half} units");
        views.push((name, camera(orthographic(half))));
    }
    views
}

fn piece_area(cloud: &mirror::Cloud) -> f64 {
    cloud.pieces.iter().map(|p| area(corners(p))).sum()
}

/// Pieces and what is counted as lost are the whole area; so are the disks, but for what an even selection of surfels of
/// different sizes scatters by.
#[test]
fn narrow_views_keep_the_area() {
    let soup = room();
    let mut wrong = Vec::new();
    for (name, camera) in narrow_views() {
        for (surfels, pieces) in [(20_000, 20_000), (1000, 100), (0, 20_000)] {
            let mut task = Task::new(&camera, SurfelizerSettings::default());
            task.capacity = CloudCapacity {
                surfels,
                pieces,
                triangles: 12,
            };
            let cloud = fixture().record_soup(&soup, &task);
            assert_alike(&cloud, &soup.mirrored(&task), &name);
            let found = piece_area(&cloud) / soup.area();
            let lost = cloud.counts.lost_area_share();
            let disks = disk_area(&cloud) / soup.area();
            let inputs = format!("{name}, room for {surfels} surfels and {pieces} pieces");
            println!(
                "{inputs}: {:?}, pieces {found:.5}, lost {lost:.5}, disks {disks:.4}",
                cloud.counts
            );
            let kept = (found + lost - 1.0).abs() < 1e-3;
            let covered = surfels == 0 || (disks - 1.0).abs() < 0.05;
            if !(kept && covered) {
                wrong.push(inputs);
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}
