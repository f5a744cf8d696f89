//! The same rays through the best tree that the crate `obvhs` builds: what a good hierarchy costs, counted and timed.

use std::time::{Duration, Instant};

use deep_screen_space::{
    Sampling,
    glam::{DVec3, UVec2, Vec3A},
    reference::{
        directions::{cell_point, hemisphere_direction},
        trace::{Receiver, Tracer},
    },
    scenes::Scene,
};
use obvhs::{
    BvhBuildParams,
    cwbvh::{CwBvh, builder::build_cwbvh_from_tris},
    ray::Ray,
    traverse,
    triangle::Triangle,
};
use rayon::prelude::*;

/// The tree, of nodes of eight children with 8 bits per plane.
pub struct Best {
    tree: CwBvh,
    triangles: Vec<Triangle>,
    pub build: Duration,
}

/// What rays took: as many as there are, nodes, triangles, hits, steps of the slowest of 32, and groups of so many.
pub type Counts = [u32; 6];

impl Best {
    pub fn new(scene: &Scene) -> Self {
        let corner = |i: u32| Vec3A::from_array(scene.positions[i as usize]);
        let triangles: Vec<Triangle> = scene
            .indices
            .chunks_exact(3)
            .map(|face| Triangle {
                v0: corner(face[0]),
                v1: corner(face[1]),
                v2: corner(face[2]),
            })
            .filter(|t| (t.v1 - t.v0).cross(t.v2 - t.v0).length_squared() > 0.0)
            .collect();
        let start = Instant::now();
        let mut core = Duration::default();
        let tree = build_cwbvh_from_tris(&triangles, BvhBuildParams::very_slow_build(), &mut core);
        Self {
            tree,
            triangles,
            build: start.elapsed(),
        }
    }

    /// Nodes visited, triangles tested, and whether there is a hit; the nearest one's, or any one's.
    fn trace(&self, mut ray: Ray, any: bool) -> [u32; 3] {
        let (mut nodes, mut tested, mut hit) = (0, 0, 0);
        let mut state = self.tree.new_traversal(ray.direction);
        let mut node;
        traverse!(
            self.tree,
            node,
            state,
            {
                nodes += 1;
                node.intersect_ray(&ray, state.oct_inv4)
            },
            {
                tested += 1;
                let index = self.tree.primitive_indices[state.primitive_id as usize];
                let t = self.triangles[index as usize].intersect(&ray);
                if t < ray.tmax {
                    ray.tmax = t;
                    hit = 1;
                    if any {
                        break;
                    }
                }
            }
        );
        [nodes, tested, hit]
    }

    /// `grid` is that of a pixel's directions; pixels are 8 × 4 to a group, one direction each.
    pub fn count(
        &self,
        (tracer, receivers): (&Tracer, &[Option<Receiver>]),
        width: u32,
        grid: [u32; 2],
        (radius, any): (f32, bool),
    ) -> Counts {
        let height = receivers.len() as u32 / width;
        let groups = [width.div_ceil(8), height.div_ceil(4)];
        (0..groups[0] * groups[1])
            .into_par_iter()
            .map(|group| {
                let first = [group % groups[0] * 8, group / groups[0] * 4];
                let mut sum = Counts::default();
                for index in 0..grid[0] * grid[1] {
                    let mut slowest = 0;
                    for lane in 0..32 {
                        let pixel = [first[0] + lane % 8, first[1] + lane / 8];
                        if pixel[0] >= width || pixel[1] >= height {
                            continue;
                        }
                        let Some(at) = receivers[(pixel[1] * width + pixel[0]) as usize] else {
                            continue;
                        };
                        let origin = tracer.start(at.position, at.geometric_normal)
                            + at.geometric_normal * tracer.epsilon();
                        let point = cell_point(pixel, index, grid, 0);
                        let drawn =
                            hemisphere_direction(point, at.shading_normal, Sampling::Cosine);
                        let ray = ray(origin, drawn.direction, radius);
                        let [nodes, tested, hit] = self.trace(ray, any);
                        for (sum, n) in sum.iter_mut().zip([1, nodes, tested, hit]) {
                            *sum += n;
                        }
                        slowest = slowest.max(nodes + tested);
                    }
                    sum[4] += slowest;
                    sum[5] += u32::from(slowest > 0);
                }
                sum
            })
            .reduce(Counts::default, |a, b| std::array::from_fn(|i| a[i] + b[i]))
    }
}

/// From 1e-5 of where it starts on, by which `f32` rounds it.
fn ray(origin: DVec3, direction: DVec3, radius: f32) -> Ray {
    let least = 1e-5 * origin.abs().max_element() as f32;
    Ray::new(
        origin.as_vec3a(),
        direction.as_vec3a(),
        least,
        radius.min(1e18),
    )
}
