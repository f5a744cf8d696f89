//! More than a cloud can hold.

use deep_screen_space::{
    CloudCapacity, SurfelizerSettings, glam::DVec3, reference::surfelizer as mirror, scenes,
};

use super::{
    comparison::compare,
    harness::{Soup, Task, area, corners, disk_area, fixture, look_at, scene_camera, sphere},
};
use support::raster::perspective;

fn setup() -> (Soup, deep_screen_space::Camera) {
    let scene = scenes::stress(4000);
    (Soup::of_scene(&scene), scene_camera(&scene, 0))
}

fn task(camera: &deep_screen_space::Camera) -> Task<'_> {
    Task::new(
        camera,
        SurfelizerSettings {
            radius_pixels: 3.0,
            density: f32::INFINITY,
            ..SurfelizerSettings::default()
        },
    )
}

/// Counted as with room, stored to capacity and no further, and the area kept. The stated few per cent: an even selection
/// of surfels of two sizes and more errs by the spread of their areas, N^(-1/2) where the list has no order.
#[test]
fn surfels_beyond_capacity_are_counted_and_made_up_for() {
    let (soup, camera) = setup();
    let mut task = task(&camera);
    let all = fixture().record_soup(&soup, &task);
    let needed = all.counts.surfels;
    for stored in [needed, needed - 1, needed / 2, needed / 3 + 1, 1000, 257, 1] {
        task.capacity.surfels = stored;
        let cloud = fixture().record_soup(&soup, &task);
        let found = format!("{needed} surfels in {stored}: {:?}", cloud.counts);
        assert_eq!(cloud.counts.surfels, needed, "{found}");
        assert_eq!(cloud.counts.stored, stored, "{found}");
        assert_eq!(cloud.counts.overflow(), needed - stored, "{found}");
        let ratio = disk_area(&cloud) / soup.area();
        println!("{found}, area {ratio:.4}");
        if stored > 1 {
            let tolerance = if stored == needed {
                1e-4
            } else {
                2.0 / f64::from(stored).sqrt()
            };
            assert!(
                (ratio - 1.0).abs() < tolerance.min(0.05),
                "{found}: area {ratio}"
            );
        }
        // Which ones stay is the mirror's choice too.
        let expected = soup.mirrored(&task);
        let differing = cloud
            .surfels
            .iter()
            .zip(&expected.surfels)
            .filter(|(p, q)| (p.piece, p.leaf) != (q.piece, q.leaf))
            .count();
        assert_eq!(expected.counts, cloud.counts);
        assert_eq!(differing, 0, "{found}");
    }
}

/// Every stretch of the full list keeps its share: none is the tail that is lost.
#[test]
fn what_stays_is_spread_over_the_list() {
    for (total, capacity) in [
        (100_000_u32, 1000),
        (1001, 1000),
        (4000, 3999),
        (3_000_000_000, 777),
    ] {
        let kept: Vec<u32> = (0..capacity)
            .map(|room| mirror::item_of(room, total, capacity))
            .collect();
        for (room, &item) in kept.iter().enumerate() {
            let even = room as f64 * f64::from(total) / f64::from(capacity);
            let stretch = f64::from(total) / f64::from(capacity);
            assert!(
                (f64::from(item) - even).abs() <= stretch + 1.0,
                "room {room} of {capacity} holds {item} of {total}"
            );
            assert_eq!(mirror::slot_for(item, total, capacity), Some(room as u32));
        }
    }
    let (soup, camera) = setup();
    let mut task = task(&camera);
    let total = fixture().record_soup(&soup, &task).counts.pieces;
    task.capacity.pieces = total / 4;
    let cloud = fixture().record_soup(&soup, &task);
    // Pieces come in the triangles' order: each tenth of the triangles keeps its share, within 15 %.
    let mut tenths = [0_u32; 10];
    for piece in &cloud.pieces {
        tenths[(piece.triangle as usize * 10) / soup.0.len()] += 1;
    }
    println!("pieces kept of each tenth of the triangles: {tenths:?} of {total}");
    let mean = f64::from(total / 4) / 10.0;
    assert!(
        tenths
            .iter()
            .all(|&n| (f64::from(n) / mean - 1.0).abs() < 0.15),
        "{tenths:?} of {total}"
    );
}

#[test]
fn pieces_beyond_capacity_are_counted_and_made_up_for() {
    let (soup, camera) = setup();
    let mut task = task(&camera);
    let all = fixture().record_soup(&soup, &task);
    let needed = all.counts.pieces;
    for capacity in [needed, needed - 1, needed / 2, 500, 1] {
        task.capacity.pieces = capacity;
        let cloud = fixture().record_soup(&soup, &task);
        let found = format!("{needed} pieces in {capacity}: {:?}", cloud.counts);
        assert_eq!(cloud.counts.pieces, needed, "{found}");
        assert_eq!(
            cloud.counts.piece_overflow(task.capacity),
            needed - capacity,
            "{found}"
        );
        assert_eq!(cloud.counts.overflow(), 0, "{found}");
        let ratio = disk_area(&cloud) / soup.area();
        println!("{found}, area {ratio:.4}");
        // The ground's triangles are two sizes; the rocks' differ.
        if capacity > 1 {
            let tolerance = if capacity == needed {
                1e-4
            } else {
                2.0 / f64::from(capacity).sqrt()
            };
            assert!(
                (ratio - 1.0).abs() < tolerance.min(0.05),
                "{found}: area {ratio}"
            );
        }
        let mut expected = soup.mirrored(&task);
        let off = expected.counts.lost_area_share() - cloud.counts.lost_area_share();
        // f32's rounding of each piece's area, and of what is below 2^-31 of the largest triangle's.
        assert!(off.abs() < 1e-5, "{found}: off by {off}");
        expected.counts.lost_area = cloud.counts.lost_area;
        assert_eq!(expected.counts, cloud.counts);
        for (p, q) in cloud.pieces.iter().zip(&expected.pieces) {
            assert_eq!([p.triangle, p.shape], [q.triangle, q.shape], "{found}");
            let off = corners(p)[0].distance(corners(q)[0]);
            assert!(off < 1e-4, "{found}: {p:?} and {q:?}");
        }
    }
}

/// Where all triangles find room but not all pieces, large triangles are cut less and nothing is lost; beyond that the area
/// is counted. Each capacity gives the mirror's pieces.
#[test]
fn pieces_are_merged_before_any_is_lost() {
    let camera = look_at(
        DVec3::new(0.3, 0.4, 0.2),
        DVec3::new(-0.5, -0.6, -0.1),
        perspective(60.0, 1.0, 1e-3),
    );
    // A ground far larger than the view, before a sphere of fine triangles.
    let corner = |x: f64, z: f64| DVec3::new(300.0 * x, -0.2, 300.0 * z);
    let mut triangles = vec![
        [corner(-1.0, -1.1), corner(-1.2, 1.0), corner(1.0, 1.3)],
        [corner(-1.0, -1.1), corner(1.0, 1.3), corner(1.1, -1.0)],
    ];
    triangles.extend(sphere(DVec3::new(-0.5, 0.4, -0.1), 0.3, 12));
    let soup = Soup::of(&triangles);
    let count = soup.0.len() as u32;
    let mut task = Task::new(&camera, SurfelizerSettings::default());
    task.settings.density = f32::INFINITY;
    let asked = fixture().record_soup(&soup, &task).counts.pieces;
    assert!(asked > 2 * count, "{asked} pieces of {count} triangles");
    let mut before = 0;
    for capacity in [
        1,
        count / 3,
        count - 1,
        count,
        count + 1,
        count + 20,
        u32::midpoint(count, asked),
        asked - 1,
        asked,
    ] {
        task.capacity.pieces = capacity;
        let cloud = fixture().record_soup(&soup, &task);
        let inputs = format!("room for {capacity} pieces: {:?}", cloud.counts);
        let area = cloud.pieces.iter().map(|p| area(corners(p))).sum::<f64>() / soup.area();
        let lost = cloud.counts.lost_area_share();
        println!("{inputs}, area {area:.6}, lost {lost:.6}");
        assert!((area + lost - 1.0).abs() < 1e-5, "{inputs}: {area}, {lost}");
        assert_eq!(lost > 0.0, capacity < count, "{inputs}");
        assert_eq!(cloud.counts.pieces + cloud.counts.merged, asked, "{inputs}");
        assert!(cloud.counts.pieces >= before, "{inputs}");
        before = cloud.counts.pieces;
        assert_eq!(
            cloud.counts.piece_overflow(task.capacity),
            count.saturating_sub(capacity)
        );
        if capacity >= count {
            // Disks of a coarse piece before the eye carry the rounding of its far corners.
            let found = compare(&cloud, &soup.mirrored(&task), 0.05);
            assert!(
                found.odd_pieces == 0 && found.far == 0,
                "{inputs}: {found:?}"
            );
        }
    }
}

/// Everything overflows at once, by a lot.
#[test]
fn the_smallest_cloud_works() {
    let (soup, camera) = setup();
    let mut task = task(&camera);
    task.capacity = CloudCapacity {
        surfels: 1,
        pieces: 1,
        triangles: soup.0.len() as u32,
    };
    let cloud = fixture().record_soup(&soup, &task);
    let [surfel] = cloud.surfels[..] else {
        panic!("{:?}", cloud.counts);
    };
    assert!(
        surfel.position.is_finite() && surfel.radius > 0.0,
        "{surfel:?}"
    );
}
