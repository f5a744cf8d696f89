//! How light is gathered at a point: a piece of WGSL and what it needs bound.

use std::{
    borrow::Cow,
    sync::{Arc, LazyLock},
};

use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use wgpu::{BindGroupLayout, Buffer, BufferUsages, Device, ShaderStages};

use super::bound::{GathererBinding, Origin};
use crate::camera::check_origin;
use crate::{
    error::Error,
    gpu::{
        binding::{self, whole},
        interface::Interface,
    },
    light::{Light, LightParams},
    made,
    recorded::Last,
};

const LABEL: &str = "deep-screen-space gatherer";

/// A gatherer: the crate's own ([`Gatherer::polygons`], [`Gatherer::lights`], [`Gatherer::surfels`]) or one of the caller's.
///
/// Its `source` is WGSL that defines one function over the types of `wgsl/common/lobes.wgsl`, and whatever it binds in
/// group 1:
///
/// ```wgsl
/// // Light that arrives at a point: samples lane, lane + lanes, lane + 2 lanes … of it. What lies far below the horizon
/// // of the normal may be left out.
/// fn gather(position: vec3f, normal: vec3f, lane: u32, lanes: u32) -> Lobes
/// ```
///
/// `position` is relative to [`FrameInput::origin`](crate::FrameInput::origin), with axes of the world.
/// `add_light(lobes, normal, direction, irradiance)` adds light from one direction,
/// `add_moments(lobes, normal, moments, radiance)` that of a source with extent. Light that is not finite counts for nothing.
#[derive(Clone, Debug)]
pub struct Gatherer {
    /// Appears in the labels of what is made for it.
    pub label: Cow<'static, str>,
    /// The WGSL.
    pub source: Cow<'static, str>,
    /// What it binds in group 1, visible to compute and fragment shaders, if anything; see [`Gatherer::bind`].
    pub layout: Option<BindGroupLayout>,
    /// Values for `override` constants of `source`: for all that have none of their own, and for no others.
    pub constants: Vec<(String, f64)>,
}

pub(crate) const POLYGONS: &str = include_str!("../../wgsl/gatherers/polygons.wgsl");
pub(crate) const LIGHTS: &str = include_str!("../../wgsl/gatherers/lights.wgsl");

/// What they bind.
static POLYGONS_INTERFACE: LazyLock<Interface> = LazyLock::new(|| Interface::of(POLYGONS));
static LIGHTS_INTERFACE: LazyLock<Interface> = LazyLock::new(|| Interface::of(LIGHTS));

/// A triangle that sends light from its front side, from which its corners run counter-clockwise. 48 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct PolygonLight {
    /// A corner, relative to the origin of the recording.
    pub a: [f32; 3],
    /// Radiosity in red, W/m².
    pub red: f32,
    /// A corner.
    pub b: [f32; 3],
    /// Radiosity in green.
    pub green: f32,
    /// A corner.
    pub c: [f32; 3],
    /// Radiosity in blue.
    pub blue: f32,
}

crate::reflection::same_as_wgsl!(
    polygon_lights_are_the_shaders: PolygonLight as "PolygonLight" in [
        "sg_hull_gather polygons", "reflective_shadow_map",
    ]
    { a, red, b, green, c, blue }
);

impl Gatherer {
    pub(super) fn built_in(
        device: &Device,
        label: &'static str,
        source: &'static str,
        interface: &Interface,
    ) -> Self {
        let stages = ShaderStages::COMPUTE | ShaderStages::FRAGMENT;
        Self {
            label: label.into(),
            source: source.into(),
            layout: Some(binding::layout_of_piece(device, LABEL, interface, stages)),
            constants: Vec::new(),
        }
    }

    /// Triangles as lights, without shadows, by the polygon-to-point form factor (Baum, Rushmeier and Winget, *Improving
    /// Radiosity Solutions Through the Use of Analytically Determined Form-Factors*, 1989).
    pub fn polygons(device: &Device) -> Self {
        Self::built_in(device, "polygons", POLYGONS, &POLYGONS_INTERFACE)
    }

    /// [`Light`]s without shadows.
    pub fn lights(device: &Device) -> Self {
        Self::built_in(device, "lights", LIGHTS, &LIGHTS_INTERFACE)
    }

    /// What [`Gatherer::polygons`] binds: a storage buffer full of [`PolygonLight`]s, at least one of them.
    ///
    /// # Errors
    /// [`Error::Buffer`] for a buffer that is too small or lacks usage `STORAGE`, [`Error::Limit`] for one longer than
    /// a binding may be, [`Error::Mismatch`] for another gatherer.
    pub fn bind_polygons(
        &self,
        device: &Device,
        lights: &Buffer,
    ) -> Result<GathererBinding, Error> {
        self.check_kind(POLYGONS, "Gatherer::polygons")?;
        binding::check_table::<PolygonLight>(device, "PolygonLight", lights)?;
        let resources = [("polygon_lights", binding::table::<PolygonLight>(lights))];
        let entries = binding::entries(&POLYGONS_INTERFACE, &resources);
        self.bound(device, &entries, Origin::Unknown, None)
    }

    /// The polygons of something that is recorded, for positions relative to what it was recorded for last.
    pub(crate) fn bind_recorded(
        &self,
        device: &Device,
        polygons: &Buffer,
        origin: &Arc<Last<DVec3>>,
    ) -> Result<GathererBinding, Error> {
        self.check_kind(POLYGONS, "Gatherer::polygons")?;
        let resources = [("polygon_lights", whole(polygons))];
        let entries = binding::entries(&POLYGONS_INTERFACE, &resources);
        self.bound(device, &entries, Origin::Map(Arc::clone(origin)), None)
    }

    /// What [`Gatherer::lights`] binds. No light is valid.
    ///
    /// # Errors
    /// What [`Light::validate`] finds, [`Error::Setting`] for an origin that is not finite, [`Error::Mismatch`] for another
    /// gatherer.
    pub fn bind_lights(
        &self,
        device: &Device,
        lights: &[Light],
        origin: DVec3,
    ) -> Result<GathererBinding, Error> {
        self.check_kind(LIGHTS, "Gatherer::lights")?;
        check_origin("Gatherer::bind_lights origin", origin)?;
        for light in lights {
            light.validate()?;
        }
        let mut params: Vec<_> = lights.iter().map(|l| LightParams::new(l, origin)).collect();
        if params.is_empty() {
            params.push(LightParams::default());
        }
        made::count(made::Kind::Buffer);
        let buffer = wgpu::util::DeviceExt::create_buffer_init(
            device,
            &wgpu::util::BufferInitDescriptor {
                label: Some(LABEL),
                contents: bytemuck::cast_slice(&params),
                usage: BufferUsages::STORAGE,
            },
        );
        let resources = [("gathered_lights", whole(&buffer))];
        let entries = binding::entries(&LIGHTS_INTERFACE, &resources);
        self.bound(device, &entries, Origin::At(origin), None)
    }
}
