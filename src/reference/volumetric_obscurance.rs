//! Mirror of `wgsl/volumetric_obscurance.wgsl`, and the integral that it estimates, by brute force.

use glam::{DVec2, DVec3};

use super::{
    depth_moments::Pyramid,
    directions::tangent_frame,
    hashing::hash2,
    receivers::Decoder,
    trace::{Receiver, Tracer},
};
use crate::{
    Camera, Combine, ObscuranceSampling, ObscuranceSettings, ObscuranceVolume,
    gbuffer::depth_step,
    receivers::DEPTH_RELATIVE,
    volumetric_obscurance::params::{frame, split, turns_uphill},
};

/// A depth buffer, with normals or without, and how it is encoded.
#[derive(Clone, Copy, Debug)]
pub struct DepthBuffer<'a> {
    /// Camera and encodings; its origin is not looked at.
    pub decoder: Decoder<'a>,
    /// Depths of the viewport's pixels, rows from the top.
    pub depths: &'a [f32],
    /// Texels of their normals.
    pub normals: &'a [[f32; 3]],
}

/// A pixel's point, relative to the camera's eye.
#[derive(Clone, Copy, Debug)]
struct Point {
    position: DVec3,
    normal: DVec3,
    axis: DVec3,
    uncertainty: f64,
    footprint: f64,
}

/// What a sample saw.
#[derive(Clone, Copy, Debug, Default)]
struct Seen {
    position: DVec3,
    spread: f64,
    covered: f64,
    inside: f64,
}

/// The sphere that is integrated over, or its half.
#[derive(Clone, Copy, Debug)]
struct Ball {
    center: DVec3,
    radius: f64,
    /// How far its plane lies from the centre along the normal, in radii.
    plane: f64,
}

/// A unit vector of the plane from the upper half of 32 random bits.
fn random_direction(bits: u32) -> DVec2 {
    let angle = (f64::from((bits >> 16) & 0x3fff) / 16384.0 - 0.5) * std::f64::consts::FRAC_PI_2;
    let a2 = angle * angle;
    let c = 1.0 - a2 * (1.0 / 2.0 - a2 * (1.0 / 24.0 - a2 * (1.0 / 720.0 - a2 / 40320.0)));
    let s = angle
        * (1.0 - a2 * (1.0 / 6.0 - a2 * (1.0 / 120.0 - a2 * (1.0 / 5040.0 - a2 / 362_880.0))));
    let turned = if bits & 0x8000_0000 != 0 {
        DVec2::new(-s, c)
    } else {
        DVec2::new(c, s)
    };
    if bits & 0x4000_0000 != 0 {
        -turned
    } else {
        turned
    }
}

/// What a pixel's samples are turned by, or reflected about, and a draw.
fn random_numbers(pixel: [u32; 2], settings: &ObscuranceSettings, points: bool) -> (DVec3, f64) {
    let place = if settings.turn {
        pixel[0] | (pixel[1] << 16)
    } else {
        0
    };
    let bits = hash2(place, settings.seed);
    let direction = random_direction(bits);
    let draw = f64::from(bits & 0xffff) / 65536.0;
    if points {
        let z = 2.0 * draw - 1.0;
        return ((direction * (1.0 - z * z).max(0.0).sqrt()).extend(z), draw);
    }
    (direction.extend(0.0), draw)
}

/// Two unit vectors across the axis: the camera's right and up, turned by the least angle.
fn across_axis(camera: &Camera, axis: DVec3) -> [DVec3; 2] {
    let [right, up, back] = frame(camera);
    let middle = (axis + back) / (1.0 + axis.dot(back));
    [right, up].map(|v| v - axis.dot(v) * middle)
}

/// How much of the heights low…high is matter.
fn matter_below(height: f64, spread: f64, low: f64, high: f64) -> f64 {
    if spread == 0.0 {
        return height.clamp(low, high) - low;
    }
    let all_below = (height - spread).clamp(low, high);
    let some_below = (height + spread).clamp(low, high);
    let mean = (height + spread - 0.5 * (all_below + some_below)) / (2.0 * spread);
    all_below - low + (some_below - all_below) * mean.clamp(0.0, 1.0)
}

impl DepthBuffer<'_> {
    fn camera(&self) -> &Camera {
        self.decoder.camera
    }

    fn surface(&self, [x, y]: [u32; 2]) -> Option<DVec3> {
        let depth = f64::from(self.depths[(y * self.camera().viewport().width + x) as usize]);
        self.decoder.unproject([x, y], depth)
    }

    /// Where a point projects to, `None` where that is nowhere in the viewport.
    fn place_of(&self, point: DVec3) -> Option<DVec2> {
        let viewport = self.camera().viewport();
        let size = DVec2::new(viewport.width.into(), viewport.height.into());
        let place = self.camera().project(point)?.truncate();
        let inside = place.cmpge(DVec2::ZERO).all() && place.cmplt(size).all();
        inside.then_some(place)
    }

    fn look(&self, point: DVec3) -> Seen {
        let Some(place) = self.place_of(point) else {
            return Seen::default();
        };
        let surface = self.surface([place.x as u32, place.y as u32]);
        Seen {
            position: surface.unwrap_or_default(),
            spread: 0.0,
            covered: f64::from(u8::from(surface.is_some())),
            inside: 1.0,
        }
    }

    fn look_around(
        &self,
        point: DVec3,
        level: f64,
        axis: DVec3,
        pyramid: &Pyramid,
        half_width: f64,
    ) -> Seen {
        let Some(place) = self.place_of(point) else {
            return Seen::default();
        };
        let m = pyramid.around(place.to_array(), level);
        let (base, direction) = self.camera().line_of_sight(place.x, place.y);
        Seen {
            position: base + direction * (m.mean + self.camera().focus_depth()),
            spread: half_width * m.variance.sqrt() * direction.dot(axis).abs(),
            covered: m.covered / m.inside.max(1e-6),
            inside: m.inside,
        }
    }

    fn point(&self, pixel: [u32; 2]) -> Option<Point> {
        let at = (pixel[1] * self.camera().viewport().width + pixel[0]) as usize;
        let depth = f64::from(self.depths[at]);
        let position = self.surface(pixel)?;
        let axis = if self.camera().is_perspective() {
            -position.normalize()
        } else {
            -self.camera().forward()
        };
        let step =
            f64::from(depth_step(self.decoder.depth_format)) + f64::from(DEPTH_RELATIVE) * depth;
        let toward_eye = if self.camera().background_depth() == 0.0 {
            depth + step
        } else {
            depth - step
        };
        let nearer = self
            .decoder
            .unproject(pixel, toward_eye)
            .filter(|_| step > 0.0)
            .map(|nearer| (nearer - position).dot(axis).abs());
        let texel = self.normals.get(at).map(|n| DVec3::from(n.map(f64::from)));
        Some(Point {
            position,
            normal: texel.map_or(axis, |texel| self.decoder.decode_normal(texel, axis)),
            axis,
            uncertainty: nearer.map_or(0.0, |apart| 2.0 * apart),
            footprint: self.camera().footprint().at(position),
        })
    }

    /// The view depths of all pixels from the camera's focus on, for [`Pyramid::new`].
    pub fn view_depths(&self) -> Vec<Option<f64>> {
        let width = self.camera().viewport().width;
        let forward = self.camera().forward();
        (0..self.depths.len() as u32)
            .map(|i| {
                self.surface([i % width, i / width])
                    .map(|p| p.dot(forward) - self.camera().focus_depth())
            })
            .collect()
    }

    /// The open share of a pixel. `pyramid` is needed for area samples.
    ///
    /// # Panics
    /// Where it is missing.
    pub fn openness(
        &self,
        pixel: [u32; 2],
        sampling: ObscuranceSampling,
        volume: ObscuranceVolume,
        settings: &ObscuranceSettings,
        pyramid: Option<&Pyramid>,
    ) -> f64 {
        let Some(point) = self.point(pixel) else {
            return 1.0;
        };
        let points = matches!(sampling, ObscuranceSampling::Points(_));
        let random = random_numbers(pixel, settings, points);
        combined(settings, |radius| {
            let Some(ball) = Ball::new(&point, volume, f64::from(radius), settings) else {
                return 1.0;
            };
            let open = self.sampled(&point, &ball, random, sampling, volume, settings, pyramid);
            scaled(open, volume)
        })
    }

    #[allow(clippy::too_many_arguments)]
    fn sampled(
        &self,
        point: &Point,
        ball: &Ball,
        (mirror, draw): (DVec3, f64),
        sampling: ObscuranceSampling,
        volume: ObscuranceVolume,
        settings: &ObscuranceSettings,
        pyramid: Option<&Pyramid>,
    ) -> f64 {
        let &Point {
            position,
            normal: n,
            axis,
            ..
        } = point;
        let [right, up] = across_axis(self.camera(), axis);
        let u = mirror.x * right + mirror.y * up;
        let v = mirror.y * right - mirror.x * up;
        let facing = n.dot(axis).max(0.02);
        let scale = ball.radius;
        let thickness = (f64::from(settings.thickness) / scale).min(4e6);
        let uncertainty = point.uncertainty / scale;
        let uphill = turns_uphill(sampling, volume);
        let (mut matter, mut total) = (0.0, 0.0);
        let (center, samples) = split(sampling, volume);
        if let Some([.., share]) = center.map(|entry| entry.map(f64::from)) {
            if uphill {
                total = share;
            } else if volume == ObscuranceVolume::Sphere {
                let occupied = (-uncertainty).max(-1.0) - (-uncertainty - thickness).max(-1.0);
                (total, matter) = (share, share * occupied / 2.0);
            } else {
                total = share / 2.0;
            }
        }
        for entry in samples {
            let [x, y, third, share] = entry.map(f64::from);
            if matches!(sampling, ObscuranceSampling::Points(_)) {
                let sample = DVec3::new(x, y, third);
                let mut v = 2.0 * sample.dot(mirror) * mirror - sample;
                if volume == ObscuranceVolume::Hemisphere {
                    v -= 2.0 * v.dot(n).min(0.0) * n;
                }
                let at = ball.center + scale * v;
                let seen = self.look(at);
                let behind = (seen.position - at).dot(axis) / scale;
                total += share * seen.inside;
                if behind > uncertainty && behind < thickness {
                    matter += share * seen.covered;
                }
                continue;
            }
            let mut p = DVec2::new(x, y);
            let rise = (p.x * u + p.y * v).dot(n) / facing;
            if uphill && rise < third * (2.0 * draw - 1.0) {
                p = -p;
            }
            let across = p.x * u + p.y * v;
            let at = ball.center + scale * across;
            let (seen, half_chord) = match sampling {
                ObscuranceSampling::Areas(_) | ObscuranceSampling::OneArea => {
                    let level = (scale / point.footprint).log2() + third;
                    let pyramid = pyramid.expect("area samples read moments");
                    let width = f64::from(settings.box_half_width);
                    let seen = self.look_around(at, level, axis, pyramid, width);
                    (seen, (1.0 - p.length_squared()).max(0.0).sqrt())
                }
                _ => (self.look(at), third),
            };
            let height = (seen.position - ball.center).dot(axis) / scale;
            let mut low = -half_chord;
            if volume != ObscuranceVolume::Sphere {
                let over = (seen.position - position).dot(n) / scale;
                let on_disk = (ball.plane - across.dot(n)) / facing;
                let plane = on_disk + (height - over / facing - on_disk) * seen.covered;
                low = plane.clamp(low, half_chord);
            }
            let whole = if uphill {
                (half_chord - low).max(1e-6)
            } else {
                2.0 * half_chord
            };
            let share = share * seen.inside / whole;
            total += share * (half_chord - low);
            if seen.covered > 0.0 {
                let front = height - uncertainty;
                let spread = seen.spread / scale;
                let occupied = matter_below(front, spread, low, half_chord)
                    - matter_below(front - thickness, spread, low, half_chord);
                matter += share * seen.covered * occupied;
            }
        }
        if total > 1e-6 {
            (1.0 - matter / total).clamp(0.0, 1.0)
        } else {
            1.0
        }
    }

    /// What the depth buffer stands for where a point projects to: depths in between those of pixels' centres are
    /// interpolated, which is exact on planes, since depth after projection is linear on screen there. Held against the
    /// nearest pixel's depth, each slope would be a staircase that shades itself.
    fn look_between(&self, point: DVec3) -> Seen {
        let Some(place) = self.place_of(point) else {
            return Seen::default();
        };
        let viewport = self.camera().viewport();
        let last = DVec2::new(viewport.width.into(), viewport.height.into()) - 1.0;
        let p = (place - 0.5).clamp(DVec2::ZERO, last);
        let corner = p.floor().min((last - 1.0).max(DVec2::ZERO));
        let f = p - corner;
        let depth = |x: f64, y: f64| {
            let at = (corner + DVec2::new(x, y)).min(last);
            f64::from(self.depths[(at.y as u32 * viewport.width + at.x as u32) as usize])
        };
        let row = |y| depth(0.0, y) * (1.0 - f.x) + depth(1.0, y) * f.x;
        let between = row(0.0) * (1.0 - f.y) + row(1.0) * f.y;
        let clamped = p + 0.5;
        let surface = self.camera().unproject(clamped.x, clamped.y, between);
        Seen {
            position: surface.unwrap_or_default(),
            spread: 0.0,
            covered: f64::from(u8::from(surface.is_some())),
            inside: 1.0,
        }
    }

    /// The integral itself over the same depth buffer: of `side`³ points on a grid about the sphere those in it, each
    /// projected and held against the depth there.
    pub fn integral(
        &self,
        pixel: [u32; 2],
        volume: ObscuranceVolume,
        settings: &ObscuranceSettings,
        side: u32,
    ) -> f64 {
        let Some(point) = self.point(pixel) else {
            return 1.0;
        };
        combined(settings, |radius| {
            let Some(ball) = Ball::new(&point, volume, f64::from(radius), settings) else {
                return 1.0;
            };
            let (mut matter, mut total) = (0.0, 0.0);
            for at in ball.grid(point.axis, point.normal, volume, side) {
                let seen = self.look_between(at);
                let behind = (seen.position - at).dot(point.axis);
                total += seen.inside;
                if behind > point.uncertainty && behind < f64::from(settings.thickness) {
                    matter += seen.covered;
                }
            }
            let open = if total > 0.0 {
                1.0 - matter / total
            } else {
                1.0
            };
            scaled(open, volume)
        })
    }
}

/// The integral over real geometry as the camera's eye sees it: what lies behind the first surface on its line of sight is
/// matter, wherever it projects to. `receiver` is in the world.
pub fn integral_of_geometry(
    camera: &Camera,
    tracer: &Tracer,
    receiver: &Receiver,
    volume: ObscuranceVolume,
    settings: &ObscuranceSettings,
    side: u32,
) -> f64 {
    let position = receiver.position - camera.eye();
    let axis = if camera.is_perspective() {
        -position.normalize()
    } else {
        -camera.forward()
    };
    let point = Point {
        position,
        normal: receiver.shading_normal,
        axis,
        uncertainty: tracer.epsilon(),
        footprint: camera.footprint().at(position),
    };
    let near = 1.0 - f64::from(camera.background_depth());
    combined(settings, |radius| {
        let Some(ball) = Ball::new(&point, volume, f64::from(radius), settings) else {
            return 1.0;
        };
        let (mut matter, mut total) = (0.0, 0.0_f64);
        for at in ball.grid(axis, point.normal, volume, side) {
            total += 1.0;
            // From the near plane on, along the line of sight.
            let from = camera
                .project(at)
                .and_then(|place| camera.unproject(place.x, place.y, near));
            let Some(from) = from else { continue };
            let reach = from.distance(at);
            let hit = tracer.first_hit(camera.eye() + from, at - from, 0.0, reach);
            if hit.is_some_and(|hit| {
                let behind = reach - hit.t;
                behind > point.uncertainty && behind < f64::from(settings.thickness)
            }) {
                matter += 1.0;
            }
        }
        scaled(1.0 - matter / total.max(1.0), volume)
    })
}

/// Half of a sphere is as open as a plane leaves it.
fn scaled(open: f64, volume: ObscuranceVolume) -> f64 {
    if volume == ObscuranceVolume::Sphere {
        (2.0 * open).min(1.0)
    } else {
        open
    }
}

/// What both radii give.
fn combined(settings: &ObscuranceSettings, openness: impl Fn(f32) -> f64) -> f64 {
    let first = openness(settings.radius);
    settings.second.map_or(first, |second| {
        let other = openness(second.radius);
        match second.combine {
            Combine::Product => first * other,
            Combine::Minimum => first.min(other),
        }
    })
}

impl Ball {
    /// `None` where f32 could not tell it from its centre.
    fn new(
        point: &Point,
        volume: ObscuranceVolume,
        world_radius: f64,
        settings: &ObscuranceSettings,
    ) -> Option<Self> {
        let radius = world_radius.min(f64::from(settings.max_pixels) * point.footprint);
        let tangent = volume == ObscuranceVolume::TangentSphere;
        let radius = if tangent { 0.5 * radius } else { radius };
        if radius <= 2e-7 * point.position.abs().max_element() || radius < 1e-30 {
            return None;
        }
        let up = f64::from(u8::from(tangent));
        Some(Self {
            center: point.position + up * radius * point.normal,
            radius,
            plane: -up,
        })
    }

    /// Points on a grid of `side` cells a side about the axis, those of the volume.
    fn grid(
        &self,
        axis: DVec3,
        normal: DVec3,
        volume: ObscuranceVolume,
        side: u32,
    ) -> impl Iterator<Item = DVec3> {
        let frame = tangent_frame(axis);
        let at = move |i: u32| (f64::from(i) + 0.5) / f64::from(side) * 2.0 - 1.0;
        let half = volume == ObscuranceVolume::Hemisphere;
        let (center, radius) = (self.center, self.radius);
        (0..side * side * side).filter_map(move |i| {
            let p = DVec3::new(at(i % side), at(i / side % side), at(i / side / side));
            let v = frame * p;
            let within = p.length_squared() < 1.0 && !(half && v.dot(normal) < 0.0);
            within.then_some(center + radius * v)
        })
    }
}
