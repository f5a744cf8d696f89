//! A lit cloud's surfels as what a hull gathers (`wgsl/gatherers/surfels.wgsl`).

use std::sync::LazyLock;

use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use wgpu::{
    Buffer, BufferUsages, CommandEncoder, Device,
    util::{BufferInitDescriptor, DeviceExt},
};

use super::{
    bound::{GathererBinding, Origin},
    gatherer::Gatherer,
};
use crate::{
    camera::check_origin,
    error::Error,
    gpu::{
        binding::{self, whole},
        interface::Interface,
    },
    made,
    shell_splatter::{
        SurfelClusters,
        params::UNBOUNDED,
        settings::{MAX_LEVELS, MIN_EPSILON, SplatSettings},
    },
    surfel::{SurfelCloud, SurfelCounts},
    surfel_shader::radiance_bytes,
};

pub(crate) const SURFELS: &str = include_str!("../../wgsl/gatherers/surfels.wgsl");

/// What it binds.
static INTERFACE: LazyLock<Interface> = LazyLock::new(|| Interface::of(SURFELS));

const LABEL: &str = "deep-screen-space surfel gatherer";

/// A lit cloud, for [`Gatherer::bind_surfels`].
#[derive(Clone, Copy, Debug)]
pub struct SurfelLight<'a> {
    /// The surfels.
    pub cloud: &'a SurfelCloud,
    /// Their clusters, recorded with `settings` for an effect that reaches as
    /// [`AmbientOcclusion`](crate::AmbientOcclusion) does, `r √(1/ε − 1)`.
    pub clusters: &'a SurfelClusters,
    /// A [`SurfelRadiance`](crate::SurfelRadiance) for each surfel that there is room for, usage `STORAGE`: what a
    /// [`SurfelShader`](crate::SurfelShader) writes.
    pub radiance: &'a Buffer,
    /// How exactly. On level l a vertex gathers from one surfel in 4^l, chosen by its position and the seed: with one level
    /// from all of them. More levels are faster and leave noise from vertex to vertex, which nothing smooths.
    pub settings: SplatSettings,
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct SurfelGatherParams {
    pub(crate) offset: [f32; 3],
    pub(crate) stored: u32,
    pub(crate) levels: u32,
    pub(crate) unbounded: u32,
    pub(crate) seed: u32,
    pub(crate) world_radius: f32,
    pub(crate) reach: f32,
    padding: [u32; 3],
    pub(crate) places: [[u32; 4]; MAX_LEVELS as usize],
}

crate::reflection::same_as_wgsl!(
    params_are_the_shaders: SurfelGatherParams as "SurfelParams" in ["sg_hull_gather surfels"]
    { offset, stored, levels, unbounded, seed, world_radius, reach, places }
);

impl Gatherer {
    /// The surfels of a lit cloud, both sides of each, by point-to-disk form factors and without shadows: one bounce of what
    /// they send, as the splatter sums it. What lies behind other surfaces shines through them; a convex room is exact.
    pub fn surfels(device: &Device) -> Self {
        Self::built_in(device, "surfels", SURFELS, &INTERFACE)
    }

    /// What [`Gatherer::surfels`] binds, for positions relative to `origin`
    /// ([`FrameInput::origin`](crate::FrameInput::origin)). Records a copy of how many surfels there are: after the
    /// recordings of cloud, clusters and radiance, before that of the hull.
    ///
    /// # Errors
    /// What [`SplatSettings::validate`] finds; [`Error::Mismatch`] for clusters of another cloud's capacity or recorded with
    /// other settings (but for the seed), and for another gatherer; [`Error::Recording`] for clusters that were not recorded from
    /// this cloud, since that was; [`Error::Setting`] for an origin that is not finite; [`Error::Buffer`] for radiance that is
    /// too small or lacks usage `STORAGE`.
    pub fn bind_surfels(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        light: &SurfelLight<'_>,
        origin: DVec3,
    ) -> Result<GathererBinding, Error> {
        self.check_kind(SURFELS, "Gatherer::surfels")?;
        check_origin("Gatherer::bind_surfels origin", origin)?;
        let SurfelLight {
            cloud,
            clusters,
            radiance,
            settings,
        } = light;
        settings.validate()?;
        clusters.check(cloud, settings)?;
        let bytes = radiance_bytes(cloud);
        binding::check_first(device, "SurfelLight::radiance", radiance, bytes)?;
        let params = SurfelGatherParams::new(settings, clusters, origin - cloud.origin());
        made::count(made::Kind::Buffer);
        let params = device.create_buffer_init(&BufferInitDescriptor {
            label: Some(LABEL),
            contents: bytemuck::bytes_of(&params),
            usage: BufferUsages::UNIFORM | BufferUsages::COPY_DST,
        });
        let from = std::mem::offset_of!(SurfelCounts, stored) as u64;
        let to = std::mem::offset_of!(SurfelGatherParams, stored) as u64;
        encoder.copy_buffer_to_buffer(&cloud.counters, from, &params, to, Some(4));
        let resources = [
            ("surfel_params", whole(&params)),
            ("gathered_surfels", whole(&cloud.surfels)),
            ("surfel_sources", whole(&cloud.sources)),
            ("surfel_radiance", binding::first(radiance, bytes)),
            ("clusters", whole(&clusters.buffer)),
        ];
        let entries = binding::entries(&INTERFACE, &resources);
        self.bound(device, &entries, Origin::At(origin), Some(cloud.last()?))
    }
}

impl SurfelGatherParams {
    fn new(settings: &SplatSettings, clusters: &SurfelClusters, offset: DVec3) -> Self {
        let mut places = [[0; 4]; MAX_LEVELS as usize];
        for (place, p) in places.iter_mut().zip(&clusters.places) {
            *place = [p.clusters, p.first_cluster, p.groups, p.first_group];
        }
        let epsilon = settings.epsilon.clamp(MIN_EPSILON, UNBOUNDED);
        Self {
            offset: offset.as_vec3().to_array(),
            stored: 0,
            levels: settings.levels,
            unbounded: u32::from(settings.unbounded),
            seed: settings.seed,
            world_radius: settings.radius.min(UNBOUNDED),
            reach: (1.0 / epsilon - 1.0).max(0.0).sqrt(),
            padding: [0; 3],
            places,
        }
    }
}
