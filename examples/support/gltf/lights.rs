//! Cameras and lights of the nodes that are in the scene.

use deep_screen_space::{
    Light,
    glam::{DMat4, DVec3},
};
use gltf::khr_lights_punctual::Kind;

use super::{File, triangles::direction};

/// A perspective camera of a file.
#[derive(Clone, Debug)]
pub struct FileCamera {
    /// Its own name, or its node's, or its number.
    pub name: String,
    pub eye: DVec3,
    /// A point in the middle of the image.
    pub target: DVec3,
    pub up: DVec3,
    pub vertical_fov_degrees: f64,
    pub near: f64,
}

/// The perspective cameras.
pub fn cameras(file: &File<'_>) -> Result<Vec<FileCamera>, String> {
    let mut cameras = Vec::new();
    for &index in &file.nodes.visible {
        let node = file.node(index)?;
        let Some(camera) = node.camera() else {
            continue;
        };
        let name = camera.name().or(node.name());
        let name = name.map_or_else(|| format!("{}", cameras.len()), str::to_string);
        let Some(lens) = &file.document.as_json().cameras[camera.index()].perspective else {
            file.notes.add(format!(
                "camera {name:?} is orthographic, which is left out"
            ));
            continue;
        };
        let [eye, ahead, up] = frame(file.nodes.to_world[index]);
        let (Some(ahead), Some(up)) = (direction(ahead), direction(up)) else {
            file.notes
                .add(format!("camera {name:?} has no direction: it is left out"));
            continue;
        };
        cameras.push(FileCamera {
            name,
            eye,
            target: eye + ahead,
            up,
            vertical_fov_degrees: f64::from(lens.yfov).to_degrees(),
            near: f64::from(lens.znear),
        });
    }
    Ok(cameras)
}

/// The lights. Their units are taken as those of radiometry: lux as W/m², candela as W/sr.
pub fn lights(file: &File<'_>) -> Result<Vec<Light>, String> {
    let mut lights = Vec::new();
    for &index in &file.nodes.visible {
        let node = file.node(index)?;
        let Some(light) = node.light() else {
            continue;
        };
        let [position, ahead, _] = frame(file.nodes.to_world[index]);
        if !matches!(light.kind(), Kind::Point) && direction(ahead).is_none() {
            file.notes.add(format!(
                "the light of node {index} has no direction: it is left out"
            ));
            continue;
        }
        let bright = light.color().map(|c| c * light.intensity());
        let light = match light.kind() {
            Kind::Directional => Light::Directional {
                direction: ahead,
                irradiance: bright,
            },
            Kind::Point => Light::Point {
                position,
                intensity: bright,
            },
            Kind::Spot {
                inner_cone_angle,
                outer_cone_angle,
            } => Light::Spot {
                position,
                direction: ahead,
                intensity: bright,
                inner: inner_cone_angle,
                outer: outer_cone_angle,
            },
        };
        light.validate().map_err(|e| format!("node {index}: {e}"))?;
        lights.push(light);
    }
    Ok(lights)
}

/// Where a node is, and its −z and its y axis.
fn frame(to_world: DMat4) -> [DVec3; 3] {
    [
        to_world.w_axis.truncate(),
        -to_world.z_axis.truncate(),
        to_world.y_axis.truncate(),
    ]
}
