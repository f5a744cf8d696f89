//! Where to look from: the command line, a file of cameras, or the scene's own views.

use std::collections::HashMap;

use deep_screen_space::{
    Camera, Light, Viewport,
    glam::DVec3,
    reference::{
        gbuffer,
        trace::{Receiver, Tracer},
    },
    scenes::Scene,
};
use serde::Deserialize;

use super::Options;
use support::{
    arguments::MAX_SIDE,
    gltf::{FileCamera, Loaded},
    lights::{from_behind, sun_unless_emissive},
    raster,
    visible::Sight,
    world::{World, bounds_of, origin_for},
};

/// The largest coordinate or distance of a camera: squares of it are within f32, as are depths.
const FARTHEST: f64 = 1e15;

/// The smallest size of a pixel, relative to its distance: that to which f32 rounds a place.
const SMALLEST_PIXEL: f64 = 1.0 / 8_388_608.0;

/// A camera, the size of its picture and its lights; places are relative to the scene's origin.
#[derive(Clone, Debug)]
pub struct Shot {
    pub eye: DVec3,
    pub target: DVec3,
    pub up: DVec3,
    pub vertical_fov_degrees: f64,
    pub near: f64,
    pub width: u32,
    pub height: u32,
    /// What lights the scene besides its own emission.
    pub lights: Vec<Light>,
}

/// What is known of a camera before the scene is looked at, in the world's coordinates.
#[derive(Clone, Copy, Debug, Deserialize)]
struct Wanted {
    eye: DVec3Array,
    target: DVec3Array,
    /// If left out, y; for one that looks along it, −z or z.
    up: Option<DVec3Array>,
    #[serde(rename = "vfov_deg")]
    vertical_fov_degrees: f64,
    /// If left out, before what is seen.
    near: Option<f64>,
    width: u32,
    height: u32,
    light: Option<LightEntry>,
}

/// A light as the file of cameras has it.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(tag = "type", rename_all = "lowercase")]
pub enum LightEntry {
    Directional {
        direction: DVec3Array,
        irradiance: [f32; 3],
    },
    Point {
        position: DVec3Array,
        intensity: [f32; 3],
    },
}

impl From<LightEntry> for Light {
    fn from(lamp: LightEntry) -> Self {
        match lamp {
            LightEntry::Directional {
                direction,
                irradiance,
            } => Self::Directional {
                direction: direction.into(),
                irradiance,
            },
            LightEntry::Point {
                position,
                intensity,
            } => Self::Point {
                position: position.into(),
                intensity,
            },
        }
    }
}

/// A light with its place relative to a point.
fn relative_to(mut light: Light, origin: DVec3) -> Result<Light, String> {
    match &mut light {
        Light::Directional { .. } => {}
        Light::Point { position, .. } | Light::Spot { position, .. } => *position -= origin,
    }
    light.validate().map_err(|e| e.to_string())?;
    Ok(light)
}

type DVec3Array = [f64; 3];

#[derive(Deserialize)]
struct Named {
    name: String,
    #[serde(flatten)]
    wanted: Wanted,
}

impl Wanted {
    /// Moves the world to where f32 is precise for this camera, and settles what was left open.
    fn settle(self, world: World, lights: &[Light]) -> Result<(Scene, Shot), String> {
        let [eye, target] = [self.eye, self.target].map(DVec3::from);
        let distance = eye.distance(target);
        if !(distance > 0.0 && distance <= FARTHEST) {
            return Err(format!(
                "the eye at {:?} cannot look at {:?}: their distance is {distance:?}, accepted is above 0, up to {FARTHEST:e}",
                self.eye, self.target
            ));
        }
        if eye.abs().max_element() > FARTHEST {
            return Err(format!(
                "the eye is at {:?}, accepted is up to {FARTHEST:e}",
                self.eye
            ));
        }
        let degrees = self.vertical_fov_degrees;
        if !(degrees > 0.0 && degrees < 180.0) {
            return Err(format!(
                "the field of view is {degrees:?} degrees, accepted is above 0 and below 180"
            ));
        }
        if 2.0 * (degrees.to_radians() / 2.0).tan() < SMALLEST_PIXEL * f64::from(self.height) {
            return Err(format!(
                "the field of view is {degrees:?} degrees: a pixel is smaller than f32 tells apart"
            ));
        }
        if let Some(near) = self.near
            && !(1.0 / FARTHEST..=FARTHEST).contains(&near)
        {
            return Err(format!(
                "near is {near:?}, accepted is {:?} to {FARTHEST:e}",
                1.0 / FARTHEST
            ));
        }
        if [self.width, self.height]
            .iter()
            .any(|n| !(1..=MAX_SIDE).contains(n))
        {
            return Err(format!(
                "the size is {}x{}, accepted is 1 to {MAX_SIDE} each",
                self.width, self.height
            ));
        }
        let up = upward((target - eye) / distance, self.up.map(DVec3::from))?;
        let origin = origin_for(world.bounds(), eye, target);
        let lights = lights.iter().map(|&light| relative_to(light, origin));
        let lights = lights.collect::<Result<_, _>>()?;
        let scene = world.relative_to(origin)?;
        let mut shot = Shot {
            eye: eye - origin,
            target: target - origin,
            up,
            vertical_fov_degrees: self.vertical_fov_degrees,
            near: self.near.unwrap_or(distance),
            width: self.width,
            height: self.height,
            lights,
        };
        if self.near.is_none() {
            shot.near = shot.near_of(&scene)?;
        }
        Ok((scene, shot))
    }
}

/// The direction that is up in a picture taken along `forward`: as asked for, else y, or what a map has for a view along it.
fn upward(forward: DVec3, wanted: Option<DVec3>) -> Result<DVec3, String> {
    let across = |up: DVec3| forward.cross(up.normalize_or_zero()).length() > 1e-9;
    let usual = [DVec3::Y, DVec3::new(0.0, 0.0, forward.y.signum())];
    match wanted {
        Some(up) if across(up) => Ok(up),
        Some(up) => Err(format!(
            "up is {up}, which does not cross the line of sight"
        )),
        None => Ok(if across(usual[0]) { usual[0] } else { usual[1] }),
    }
}

impl Shot {
    pub fn camera(&self) -> Result<Camera, String> {
        let aspect = f64::from(self.width) / f64::from(self.height);
        Camera::look_at(
            self.eye,
            self.target,
            self.up,
            raster::perspective(self.vertical_fov_degrees, aspect, self.near),
            Viewport::full(self.width, self.height),
        )
        .map_err(|e| e.to_string())
    }

    /// A near plane that cuts off nothing of what is seen, however large the rest of the scene. With depth reversed and
    /// without a far plane, a small one costs no precision; surfels grow no finer than they are at it.
    fn near_of(&self, scene: &Scene) -> Result<f64, String> {
        let upward = (self.vertical_fov_degrees.to_radians() / 2.0).tan();
        let sight = Sight {
            eye: self.eye,
            rotation: self.camera()?.rotation(),
            tangents: [
                upward * f64::from(self.width) / f64::from(self.height),
                upward,
            ],
        };
        let away = self.eye.distance(self.target);
        // A target far beyond the scene is a direction. A scene of points has no size.
        let (low, high) = bounds_of(scene);
        let size = match low.distance(high) {
            extent if extent > 0.0 => away.min(extent),
            _ => away,
        };
        let before = sight
            .least_depth(scene)
            .map_or(f64::INFINITY, |depth| 0.5 * depth);
        // What goes through the eye itself has no near plane before it.
        Ok(before.min(1e-3 * size).max(1e-6 * size))
    }

    /// What a ray through each pixel's centre sees.
    pub fn receivers(&self, scene: &Scene, tracer: &Tracer) -> Vec<Option<Receiver>> {
        let Ok(camera) = self.camera() else {
            return Vec::new();
        };
        gbuffer::receivers(
            &camera,
            tracer,
            &scene.positions,
            &scene.normals,
            &scene.indices,
        )
    }
}

impl Shot {
    /// The albedo of what a ray through each pixel's centre sees; black for the sky.
    pub fn albedo(&self, scene: &Scene, tracer: &Tracer) -> Vec<DVec3> {
        let Ok(camera) = self.camera() else {
            return Vec::new();
        };
        let materials = scene.triangle_materials();
        gbuffer::cast(
            &camera,
            tracer,
            &scene.positions,
            &scene.normals,
            &scene.indices,
        )
        .into_iter()
        .map(|pixel| {
            pixel.map_or(DVec3::ZERO, |p| {
                DVec3::from(materials[p.triangle].albedo.map(f64::from))
            })
        })
        .collect()
    }
}

/// Picks the view that the options ask for, and the scene as it is seen from there.
pub fn choose(options: &Options, loaded: Loaded) -> Result<(Scene, Shot), String> {
    let world = loaded.world;
    let mut wanted = if let Some(file) = &options.cameras {
        from_file(options, file)?
    } else if !loaded.cameras.is_empty() && (options.eye.is_none() || options.camera.is_some()) {
        from_gltf(options, &loaded.cameras)?
    } else if options.eye.is_some() || world.scene.views.is_empty() {
        if world.scene.views.is_empty() && options.camera.is_some() {
            return Err(unknown(options.camera.as_deref(), &[]));
        }
        around(&world)
    } else {
        from_scene(options, &world.scene)?
    };
    let mut lights: Vec<Light> = match wanted.light {
        Some(lamp) => vec![lamp.into()],
        None => loaded.lights,
    };
    let unlit = lights.is_empty() && options.cameras.is_none();
    if unlit && options.effect != "sss" {
        lights.extend(sun_unless_emissive(&world.scene));
    }
    if let (Some(eye), Some(target)) = (options.eye, options.target) {
        wanted.eye = eye.to_array();
        wanted.target = target.to_array();
        // Those were of another place.
        (wanted.near, wanted.up) = (None, None);
    }
    if let Some(up) = options.up {
        wanted.up = Some(up.to_array());
    }
    if let Some(near) = options.near {
        wanted.near = Some(near);
    }
    if let Some(vfov) = options.vfov {
        wanted.vertical_fov_degrees = vfov;
    }
    if let Some([width, height]) = options.size {
        wanted.width = width;
        wanted.height = height;
    }
    if unlit && options.effect == "sss" {
        lights.push(from_behind(wanted.eye.into(), wanted.target.into()));
    }
    wanted.settle(world, &lights)
}

fn from_gltf(options: &Options, cameras: &[FileCamera]) -> Result<Wanted, String> {
    let list: Vec<_> = cameras.iter().map(|c| c.name.as_str()).collect();
    let wanted = options.camera.as_deref();
    let camera = cameras
        .iter()
        .find(|c| wanted.is_none_or(|w| w == c.name))
        .ok_or_else(|| unknown(wanted, &list))?;
    Ok(Wanted {
        eye: camera.eye.to_array(),
        target: camera.target.to_array(),
        up: Some(camera.up.to_array()),
        vertical_fov_degrees: camera.vertical_fov_degrees,
        near: Some(camera.near),
        width: 768,
        height: 512,
        light: None,
    })
}

fn from_file(options: &Options, file: &std::path::Path) -> Result<Wanted, String> {
    let name = file.display();
    let text = std::fs::read_to_string(file).map_err(|e| format!("{name}: {e}"))?;
    let scenes: HashMap<String, Vec<Named>> =
        serde_json::from_str(&text).map_err(|e| format!("{name}: {e}"))?;
    let stem = options
        .scene
        .as_deref()
        .and_then(|s| std::path::Path::new(s).file_stem())
        .map(|s| s.to_string_lossy().into_owned())
        .unwrap_or_default();
    let cameras = scenes
        .get(&stem)
        .ok_or_else(|| format!("{name}: has no cameras for {stem}"))?;
    let list: Vec<_> = cameras.iter().map(|c| c.name.as_str()).collect();
    let wanted = options.camera.as_deref();
    cameras
        .iter()
        .find(|c| wanted.is_none_or(|w| w == c.name))
        .map(|c| c.wanted)
        .ok_or_else(|| unknown(wanted, &list))
}

fn from_scene(options: &Options, scene: &Scene) -> Result<Wanted, String> {
    let list: Vec<_> = scene.views.iter().map(|v| v.name).collect();
    let wanted = options.camera.as_deref();
    let view = scene
        .views
        .iter()
        .find(|v| wanted.is_none_or(|w| w == v.name))
        .ok_or_else(|| unknown(wanted, &list))?;
    Ok(Wanted {
        eye: view.eye,
        target: view.target,
        up: Some(view.up),
        vertical_fov_degrees: view.vertical_fov_degrees,
        near: Some(view.near),
        width: 768,
        height: 512,
        light: None,
    })
}

fn unknown(wanted: Option<&str>, list: &[&str]) -> String {
    let only = match list {
        [] => "nor any other".into(),
        _ => format!("only {}", list.join(", ")),
    };
    format!("there is no camera {}, {only}", wanted.unwrap_or("at all"))
}

/// A view of the whole scene from a corner above it.
fn around(world: &World) -> Wanted {
    let [eye, target] = world.corner_view();
    Wanted {
        eye: eye.to_array(),
        target: target.to_array(),
        up: None,
        vertical_fov_degrees: 45.0,
        near: None,
        width: 768,
        height: 512,
        light: None,
    }
}

/// `x,y,z`.
pub fn parse_point(text: &str) -> Result<DVec3, String> {
    let parts: Vec<f64> = text
        .split(',')
        .map(|t| t.trim().parse::<f64>().ok().filter(|v| v.is_finite()))
        .collect::<Option<_>>()
        .ok_or("three finite numbers, x,y,z")?;
    match parts[..] {
        [x, y, z] => Ok(DVec3::new(x, y, z)),
        _ => Err("three finite numbers, x,y,z".into()),
    }
}

/// A distance of 0 or more, or `inf`.
pub fn parse_radius(text: &str) -> Result<f32, String> {
    text.parse::<f32>()
        .ok()
        .filter(|r| *r >= 0.0)
        .ok_or_else(|| "a distance of 0 or more, or inf".into())
}

/// A number from 0 to 1.
pub fn parse_share(text: &str) -> Result<f32, String> {
    text.parse::<f32>()
        .ok()
        .filter(|share| (0.0..=1.0).contains(share))
        .ok_or_else(|| "a number from 0 to 1".into())
}
