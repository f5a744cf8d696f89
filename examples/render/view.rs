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

use crate::{
    Options,
    support::{gltf::Loaded, raster},
};

/// A camera and the size of its picture.
#[derive(Clone, Debug, Deserialize)]
pub struct Shot {
    pub eye: DVec3Array,
    pub target: DVec3Array,
    #[serde(default = "up")]
    pub up: DVec3Array,
    #[serde(rename = "vfov_deg")]
    pub vertical_fov_degrees: f64,
    pub near: f64,
    pub width: u32,
    pub height: u32,
    /// What lights the scene besides its own emission.
    #[serde(default)]
    pub light: Option<Lamp>,
    /// The glTF file's own lights, in place of `light` where that has none.
    #[serde(skip)]
    pub file_lights: Vec<Light>,
}

/// A light as the file of cameras has it.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(tag = "type", rename_all = "lowercase")]
pub enum Lamp {
    Directional {
        direction: DVec3Array,
        irradiance: [f32; 3],
    },
    Point {
        position: DVec3Array,
        intensity: [f32; 3],
    },
}

impl From<Lamp> for Light {
    fn from(lamp: Lamp) -> Self {
        match lamp {
            Lamp::Directional {
                direction,
                irradiance,
            } => Self::Directional {
                direction: direction.into(),
                irradiance,
            },
            Lamp::Point {
                position,
                intensity,
            } => Self::Point {
                position: position.into(),
                intensity,
            },
        }
    }
}

type DVec3Array = [f64; 3];

fn up() -> DVec3Array {
    [0.0, 1.0, 0.0]
}

#[derive(Deserialize)]
struct Named {
    name: String,
    #[serde(flatten)]
    shot: Shot,
}

impl Shot {
    pub fn camera(&self) -> Result<Camera, String> {
        let aspect = f64::from(self.width) / f64::from(self.height);
        if !(self.vertical_fov_degrees > 0.0 && self.vertical_fov_degrees < 180.0) {
            return Err(format!(
                "the field of view is {} degrees, accepted is above 0 and below 180",
                self.vertical_fov_degrees
            ));
        }
        if !(self.near > 0.0 && self.near.is_finite()) {
            return Err(format!("near is {}, accepted is above 0", self.near));
        }
        Camera::look_at(
            self.eye.into(),
            self.target.into(),
            self.up.into(),
            raster::perspective(self.vertical_fov_degrees, aspect, self.near),
            Viewport::full(self.width, self.height),
        )
        .map_err(|e| e.to_string())
    }

    pub fn lights(&self) -> Vec<Light> {
        match self.light {
            Some(lamp) => vec![lamp.into()],
            None => self.file_lights.clone(),
        }
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

/// Picks the view that the options ask for, relative to what was loaded.
pub fn choose(options: &Options, loaded: &Loaded) -> Result<Shot, String> {
    let scene = &loaded.scene;
    let relative = |place: DVec3Array| (DVec3::from(place) - loaded.origin).to_array();
    let mut shot = if let Some(file) = &options.cameras {
        let mut shot = from_file(options, file)?;
        shot.eye = relative(shot.eye);
        shot.target = relative(shot.target);
        if let Some(Lamp::Point { position, .. }) = &mut shot.light {
            *position = relative(*position);
        }
        shot
    } else if !loaded.cameras.is_empty() && (options.eye.is_none() || options.camera.is_some()) {
        from_gltf(options, loaded)?
    } else if options.eye.is_some() || scene.views.is_empty() {
        around(scene)
    } else {
        from_scene(options, scene)?
    };
    if let (Some(eye), Some(target)) = (options.eye, options.target) {
        shot.eye = relative(eye.to_array());
        shot.target = relative(target.to_array());
    }
    if let Some(vfov) = options.vfov {
        shot.vertical_fov_degrees = vfov;
    }
    if let Some([width, height]) = options.size {
        shot.width = width;
        shot.height = height;
    }
    shot.file_lights.clone_from(&loaded.lights);
    if shot.light.is_none() && shot.file_lights.is_empty() && options.cameras.is_none() {
        shot.light = sun_unless_emissive(scene);
    }
    Ok(shot)
}

fn from_gltf(options: &Options, loaded: &Loaded) -> Result<Shot, String> {
    let list: Vec<_> = loaded.cameras.iter().map(|c| c.name.as_str()).collect();
    let wanted = options.camera.as_deref();
    let camera = loaded
        .cameras
        .iter()
        .find(|c| wanted.is_none_or(|w| w == c.name))
        .ok_or_else(|| unknown(wanted, &list))?;
    Ok(Shot {
        eye: camera.eye.to_array(),
        target: camera.target.to_array(),
        up: camera.up.to_array(),
        vertical_fov_degrees: camera.vertical_fov_degrees,
        near: camera.near,
        width: 768,
        height: 512,
        light: None,
        file_lights: Vec::new(),
    })
}

fn from_file(options: &Options, file: &std::path::Path) -> Result<Shot, String> {
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
        .map(|c| c.shot.clone())
        .ok_or_else(|| unknown(wanted, &list))
}

fn from_scene(options: &Options, scene: &Scene) -> Result<Shot, String> {
    let list: Vec<_> = scene.views.iter().map(|v| v.name).collect();
    let wanted = options.camera.as_deref();
    let view = scene
        .views
        .iter()
        .find(|v| wanted.is_none_or(|w| w == v.name))
        .ok_or_else(|| unknown(wanted, &list))?;
    Ok(Shot {
        eye: view.eye,
        target: view.target,
        up: view.up,
        vertical_fov_degrees: view.vertical_fov_degrees,
        near: view.near,
        width: 768,
        height: 512,
        light: None,
        file_lights: Vec::new(),
    })
}

/// Late morning, for a scene without a light of its own.
fn sun_unless_emissive(scene: &Scene) -> Option<Lamp> {
    let dark = scene
        .materials
        .iter()
        .all(|material| material.emission == [0.0; 3]);
    dark.then_some(Lamp::Directional {
        direction: [0.45, -0.8, -0.4],
        irradiance: [3.2, 3.1, 2.9],
    })
}

fn unknown(wanted: Option<&str>, list: &[&str]) -> String {
    format!(
        "there is no camera {}, only {}",
        wanted.unwrap_or("at all"),
        list.join(", ")
    )
}

/// A view of the whole scene from a corner above it.
fn around(scene: &Scene) -> Shot {
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for p in &scene.positions {
        let p = DVec3::from(p.map(f64::from));
        low = low.min(p);
        high = high.max(p);
    }
    let center = (low + high) / 2.0;
    let size = (high - low).length();
    Shot {
        eye: (center + size * DVec3::new(0.6, 0.4, 0.8)).to_array(),
        target: center.to_array(),
        up: up(),
        vertical_fov_degrees: 45.0,
        near: 1e-3 * size,
        width: 768,
        height: 512,
        light: None,
        file_lights: Vec::new(),
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
