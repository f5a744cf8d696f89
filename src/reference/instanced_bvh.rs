//! Mirror of `wgsl/instanced_bvh.wgsl` and of what `wgsl/common/bvh_traverse.wgsl` does with instances: each ray against every
//! triangle of every one, in the mesh's own space.

use glam::{DMat3, DMat4, DVec3};
use rayon::prelude::*;

use super::{
    bounced_z_buffer::{FAR, POSITION_TOLERANCE, Ray, Tracing, end_size_of, lit_surface},
    light::arrival,
    surfelizer::Triangle,
};
use crate::{Light, Material};

const SPACE_TOLERANCE: f64 = 5e-7;
const SHORTEST: f64 = 1e-15;
const FLATTEST: f64 = 1e-6;

/// An instance of a mesh.
#[derive(Clone, Copy, Debug)]
pub struct Instance<'a> {
    /// Takes what `shift` was subtracted from to the mesh's space.
    pub to_mesh: DMat3,
    /// Where the mesh's first vertex is, relative to the scene's origin.
    pub shift: DVec3,
    /// The mesh's triangles relative to its first vertex.
    pub triangles: &'a [Triangle],
    /// Index of its material.
    pub material: usize,
}

/// What a ray meets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance.
    pub t: f64,
    /// Index of the instance.
    pub instance: usize,
    /// Index of the triangle of its mesh.
    pub triangle: usize,
}

/// A mesh's triangles relative to its first vertex, which is also given.
pub fn own_triangles(mesh: &[[DVec3; 3]]) -> (DVec3, Vec<Triangle>) {
    let anchor = mesh.first().map_or(DVec3::ZERO, |corners| corners[0]);
    let own = mesh.iter().map(|corners| {
        let [a, b, c] = corners.map(|corner| corner - anchor);
        Triangle { a, b, c }
    });
    (anchor, own.collect())
}

impl<'a> Instance<'a> {
    /// An instance relative to `origin`, or `None` for one that is left out.
    pub fn new(
        transform: &DMat4,
        origin: DVec3,
        (anchor, triangles): (DVec3, &'a [Triangle]),
        material: usize,
    ) -> Option<Self> {
        let m = DMat3::from_mat4(*transform);
        let shift = m * anchor + (transform.w_axis.truncate() - origin);
        let scale = DVec3::new(m.x_axis.length(), m.y_axis.length(), m.z_axis.length());
        let axes = DMat3::from_cols(m.x_axis / scale.x, m.y_axis / scale.y, m.z_axis / scale.z);
        let volume = axes.determinant();
        let usable = scale.is_finite()
            && shift.is_finite()
            && scale.min_element() >= SHORTEST
            && scale.max_element() <= 1.0 / SHORTEST
            && volume.abs() >= FLATTEST;
        usable.then(|| Self {
            to_mesh: m.inverse(),
            shift,
            triangles,
            material,
        })
    }

    /// Along the normal of one of its triangles, in the scene's space.
    fn normal_of(&self, triangle: usize) -> DVec3 {
        let t = &self.triangles[triangle];
        self.to_mesh.transpose() * (t.b - t.a).cross(t.c - t.a).normalize_or_zero()
    }
}

/// A ray in the space of an instance's mesh.
struct Within {
    ray: Ray,
    /// How large what its origin was computed of is there.
    reach: DVec3,
    /// And the coordinates of the light.
    end_reach: Option<DVec3>,
}

fn ray_within(ray: &Ray, end_size: Option<f64>, instance: &Instance<'_>) -> Within {
    let rows = instance.to_mesh;
    let sizes = DMat3::from_cols(rows.x_axis.abs(), rows.y_axis.abs(), rows.z_axis.abs());
    let direction = rows * ray.direction;
    Within {
        ray: Ray {
            origin: rows * (ray.origin - instance.shift),
            direction,
            left: None,
        },
        reach: sizes * (ray.origin.abs() + instance.shift.abs()),
        end_reach: end_size.map(|size| sizes * DVec3::splat(size)),
    }
}

/// Where such a ray meets a triangle, from either side.
fn meet(within: &Within, triangle: &Triangle) -> Option<(f64, [f64; 2])> {
    let Within { ray, reach, .. } = within;
    let a = triangle.a;
    let e1 = triangle.b - a;
    let e2 = triangle.c - a;
    let d = ray.direction;
    let p = d.cross(e2);
    let det = e1.dot(p);
    let s = ray.origin - a;
    let q = s.cross(e1);
    let per_det = 1.0 / det;
    let u = s.dot(p) * per_det;
    let v = d.dot(q) * per_det;
    let ahead = e2.dot(q) * per_det;
    let mut t = ahead;
    let all = *reach + a.abs();
    let rounding = POSITION_TOLERANCE * per_det.abs() * all;
    let slack_u = rounding.dot(p.abs());
    let slack_v = rounding.dot(e1.cross(d).abs());
    let slack = slack_u + slack_v;
    let across = e1.cross(e2).abs();
    let least = SPACE_TOLERANCE * per_det.abs() * reach.dot(across);
    if let Some(end_reach) = within.end_reach {
        t += POSITION_TOLERANCE * per_det.abs() * (all + end_reach).dot(across);
    }
    let inside = u >= -slack_u
        && v >= -slack_v
        && u + v <= 1.0 + slack
        && ahead > least
        && det.abs() > 1e-35;
    inside.then_some((t, [u, v]))
}

/// The nearest hit closer than `t_max`.
pub fn nearest(ray: &Ray, instances: &[Instance<'_>], t_max: f64) -> Option<Hit> {
    nearest_where(ray, instances, t_max, |_, _, _| true)
}

/// The same among triangles that are where `is_there` says, of an instance, a triangle and weights of its second and third
/// corner.
pub(super) fn nearest_where(
    ray: &Ray,
    instances: &[Instance<'_>],
    t_max: f64,
    is_there: impl Fn(usize, usize, [f64; 2]) -> bool,
) -> Option<Hit> {
    traverse(ray, None, instances, t_max, is_there)
}

/// Whether a light reaches a point off a surface.
pub fn unshadowed(point: DVec3, light: &Light, instances: &[Instance<'_>]) -> bool {
    let way = arrival(light, point);
    let ray = Ray {
        origin: point,
        direction: way.to_light,
        left: None,
    };
    let t_max = way.distance.min(FAR);
    traverse(&ray, end_size_of(light), instances, t_max, |_, _, _| true).is_none()
}

fn traverse(
    ray: &Ray,
    end_size: Option<f64>,
    instances: &[Instance<'_>],
    t_max: f64,
    is_there: impl Fn(usize, usize, [f64; 2]) -> bool,
) -> Option<Hit> {
    let mut hit = None;
    let mut closest = t_max;
    for (instance, candidate) in instances.iter().enumerate() {
        let within = ray_within(ray, end_size, candidate);
        for (triangle, corners) in candidate.triangles.iter().enumerate() {
            if let Some((t, place)) = meet(&within, corners)
                && t < closest
                && is_there(instance, triangle, place)
            {
                closest = t;
                hit = Some(Hit {
                    t,
                    instance,
                    triangle,
                });
            }
        }
    }
    hit
}

/// What each ray of a view meets first among instances; the view's pieces are not asked.
pub fn hits(tracing: &Tracing<'_>, instances: &[Instance<'_>]) -> Vec<Option<Hit>> {
    let t_max = f64::from(tracing.settings.radius).min(FAR);
    let rays = tracing.rays();
    rays.par_iter()
        .map(|ray| nearest((*ray).as_ref()?, instances, t_max))
        .collect()
}

/// What each ray of a view brings with [`Payload::LitRadiance`](crate::Payload::LitRadiance): colours not yet packed. `lights`
/// are relative to the scene's origin.
pub fn lit(
    tracing: &Tracing<'_>,
    instances: &[Instance<'_>],
    materials: &[Material],
    lights: &[Light],
) -> Vec<DVec3> {
    let sky = DVec3::from(tracing.settings.sky_radiance.map(f64::from));
    let rays = tracing.rays();
    rays.par_iter()
        .zip(hits(tracing, instances))
        .map(|(ray, hit)| match (ray, hit) {
            (None, _) => DVec3::ZERO,
            (Some(_), None) => sky,
            (Some(ray), Some(hit)) => {
                let instance = &instances[hit.instance];
                let normal = instance.normal_of(hit.triangle);
                let material = &materials[instance.material.min(materials.len() - 1)];
                let reaches = |point, light: &Light| unshadowed(point, light, instances);
                lit_surface((ray, hit.t), normal, material, lights, reaches)
            }
        })
        .collect()
}
