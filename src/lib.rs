//! Ambient occlusion, the light of skies and light that bounces for wgpu, from all surfaces of a scene, so that what is hidden,
//! off screen or edge-on counts like what is seen (Nalbach, Ritschel and Seidel, *Deep Screen Space*, 2014, and *The Bounced
//! Z-buffer for Indirect Visibility*, 2015).
//!
//! Most callers need two objects: a [`RayTracedScene`], and for each view and effect a [`RayTracedView`]. What the depth buffer
//! alone holds needs one, a [`NearFieldView`]; light of many sources on large pictures two, [`HullLights`] and [`HullView`]. All
//! are wired of passes that may be used by themselves, each of which records into the caller's encoder and owns only what it
//! makes:
//!
//! * [`GBufferDecoder`]: the caller's G-buffer, decoded once per frame and view into the [`Frame`] that passes start from.
//! * [`Surfelizer`]: the caller's triangles become a [`SurfelCloud`], finer near the camera than far from it.
//! * [`SurfelHoles`]: surfels of alpha-tested triangles, foliage and fences, made as large as what is there of them.
//! * [`SurfelShader`]: what each surfel sends of the caller's [`Light`]s, for effects that bounce light.
//! * [`SurfelGatherer`]: what surfels send of the light that others send them, for light that bounces more than once.
//! * [`EnvironmentBuilder`]: a caller's sky, as rays that meet nothing bring it.
//! * [`EmittersBuilder`]: the surfaces that shine of themselves, for rays to be aimed at.
//! * [`ShellSplatter`]: sums over the surfels for every pixel of the caller's G-buffer, near ones at full resolution and
//!   far ones ever more coarsely. What a surfel adds to a pixel is an [`Effect`], the crate's ([`AmbientOcclusion`],
//!   [`DiffuseBounce`], [`SpecularBounce`], [`SubsurfaceScattering`], [`BentNormals`], [`DirectionalOcclusion`]), one of the
//!   caller's, in WGSL, or two of them in one splat ([`Effect::and`]).
//! * [`Reconstructor`]: the sums smoothed, added up and written into the caller's texture.
//! * [`BouncedZBuffer`] in place of the splatter, where it matters what hides what: what each pixel meets first along N
//!   directions of its own, exactly. Its noise falls with N, and nothing else is approximate.
//! * [`HitResolver`]: ambient visibility, or one bounce of diffuse or glossy light, from those hits and the neighbours'.
//! * [`MultiResMask`] and [`MultiResReconstructor`]: an effect at the resolution that each part of the image needs, and
//!   [`SoftShadows`] and [`ScreenSpaceGi`], which can be computed so (Besenthal, Maisch and Ropinski, *Multi-Resolution
//!   Rendering for Computationally Expensive Lighting Effects*, 2019).
//! * [`SgHull`], for many lights or an expensive gather: light is gathered at the vertices of quads that follow what is
//!   seen, as spherical Gaussians ([`spherical_gaussian`]), and integrated at every pixel.
//! * [`planner`]: which of these, and with which settings, meets an error or a time.
//! * [`TemporalAccumulator`], if the caller likes: the mean of the picture over frames. Without it no state survives a
//!   frame.
//!
//! # Conventions
//!
//! * **Spaces.** The caller's world is in `f64` on the CPU ([`Camera`]). On the GPU all positions have axes of the
//!   world and their origin at the [focus](Camera::focus) of the camera that the cloud was recorded for, a point near what
//!   it sees. Front faces wind counter-clockwise.
//! * **Depth** is what the projection makes of it. Forward or reversed, finite or infinite, perspective or orthographic
//!   is read off the matrix; a pixel at the far end of the depth range is sky.
//! * **Images** have row 0 on top. Only the camera's viewport is read and written.
//! * **Requirements.** Nothing beyond `Limits::default()`, and no feature. `SUBGROUP` is used where the caller asks for
//!   it, and timestamps are written where it passes a query set. With the crate's feature `ray-query` the device may trace rays
//!   itself (`Primitives::RayQuery`), where it was made for that.
//! * **Errors.** What cannot be honoured is an [`Error`] that names the thing, its value and what is accepted, before
//!   anything is recorded. What the GPU alone can find, such as surfels that found no room, is counted in
//!   [`SurfelCounts`], for the caller to read when it likes.
//! * **Order.** Objects know what they were recorded from, and those that were not, or not since that was recorded, are
//!   refused. What counts is the order of recordings: encoders have to be submitted in it.
//! * **Not checked** is what wgpu does not tell: destroyed textures and buffers, those of another device, a texture's
//!   `view_formats`, and WGSL that does not compile. They are wgpu's own validation errors.
//! * **Determinism.** The same input on the same device gives the same bits: no sum depends on the order of threads.
//!   Where the device traces rays itself it builds what they traverse as it likes, and which of several hits an occlusion ray
//!   finds may differ from run to run.
//! * **Lifetimes.** Passes hold pipelines and serve any number of scenes and views. Several recordings may go into one
//!   encoder, and encoders be dropped. Objects keep the bind groups of their last recording for the next, and with them the
//!   buffers that it was given; of the caller's textures they keep nothing.
//!
//! # Example
//!
//! ```no_run
//! use deep_screen_space::*;
//!
//! /// Ambient occlusion of `meshes` into `target`, an `R8Unorm` texture of the G-buffer's size.
//! fn occlude(
//!     device: &wgpu::Device,
//!     encoder: &mut wgpu::CommandEncoder,
//!     meshes: &[Mesh<'_>],
//!     camera: &Camera,
//!     gbuffer: GBuffer<'_>,
//!     target: &wgpu::Texture,
//! ) -> Result<(), Error> {
//!     // Once per scene, and once per view and effect. Occluders count up to 2 world units away.
//!     let effect = RayTracedEffect::AmbientOcclusion { radius: 2.0 };
//!     let format = wgpu::TextureFormat::R8Unorm;
//!     let descriptor = RayTracedViewDescriptor::new(effect, Quality::Balanced, format);
//!     let mut scene = RayTracedScene::new(device)?;
//!     let mut occlusion = RayTracedView::new(device, &descriptor)?;
//!
//!     // Every frame: the scene, for all its views, and each view's picture.
//!     let input = RayTracedSceneInput {
//!         cull_by: &[*camera],
//!         reach: 2.0,
//!         ..RayTracedSceneInput::new(Geometry { meshes }, camera)
//!     };
//!     scene.record(device, encoder, &input)?;
//!     occlusion.record(device, encoder, &scene, &RayTracedInput::new(gbuffer, camera, target))
//! }
//! ```
//!
//! `examples/minimal.rs` is the same as a program, and `examples/by_hand.rs` does it pass by pass. With the feature `reference`
//! come the mirrors of all passes in `f64` and a ray tracer for the truth; with `scenes`, scenes made in code.

#![deny(missing_docs)]

pub use glam;
pub use wgpu;

mod alpha_test;
mod bounced_z_buffer;
mod bvh;
mod camera;
mod depth_moments;
mod effect;
mod effects;
mod emitters;
mod environment;
mod error;
mod gbuffer;
mod geometry;
mod gpu;
mod hit_resolver;
mod hull;
mod instanced_bvh;
mod light;
mod made;
mod mesh_binding;
mod multi_res_mask;
mod multi_res_reconstructor;
mod near_field;
mod overrides;
pub mod planner;
mod ray_budget;
mod ray_traced;
mod receivers;
mod reconstructor;
mod recorded;
#[cfg(feature = "reference")]
pub mod reference;
mod reflection;
mod reflective_shadow_map;
mod room;
#[cfg(feature = "scenes")]
pub mod scenes;
mod screen_space_gi;
mod sg_hull;
mod shaders;
mod shell_splatter;
mod soft_shadows;
pub mod spherical_gaussian;
mod surfel;
mod surfel_gatherer;
mod surfel_holes;
mod surfel_shader;
mod surfelizer;
mod temporal_accumulator;
mod texture_slice;
mod volumetric_obscurance;
mod work;

pub use alpha_test::settings::{
    AlphaChannel, AlphaTest, AlphaTests, AlphaWrap, TexCoordFormat, TexCoords,
};
pub use bounced_z_buffer::{
    BouncedInput, BouncedZBuffer,
    descriptor::{BouncedDescriptor, BouncedScene, HitLighting, HitRadiance, Payload},
    settings::{BouncedSettings, DiskSettings, Merge, Sampling},
    view::BouncedView,
};
pub use bvh::{AlphaTestedInput, Bvh, BvhBuilder, Primitives};
pub use camera::{Camera, Footprint, Viewport};
pub use depth_moments::DepthMoments;
pub use effect::{Channels, Effect};
pub use effects::{
    ambient_occlusion::{AmbientOcclusion, Overlap},
    bent_normals::BentNormals,
    diffuse_bounce::DiffuseBounce,
    directional_occlusion::DirectionalOcclusion,
    scattering::{Dipole, Scattering},
    specular_bounce::SpecularBounce,
    subsurface_scattering::SubsurfaceScattering,
};
pub use emitters::{Emitters, EmittersBuilder, EmittersInput};
pub use environment::{
    Environment, EnvironmentBuilder, EnvironmentInput, EnvironmentLight, EnvironmentSource,
    settings::EnvironmentSettings,
};
pub use error::Error;
pub use gbuffer::{GBuffer, NormalEncoding, NormalSpace, Normals};
pub use geometry::{
    Geometry, IndexFormat, Indices, Instances, Material, Mesh, PositionFormat, TransformFormat,
    Vertices,
};
pub use gpu::{Timestamps, compiler::Compiler, listing::Shader};
pub use hit_resolver::{
    HitEstimateInput, HitResolver, HitResolverDescriptor, HitResolverInput, HitResolverView,
    settings::HitResolverSettings,
};
pub use hull::{
    lights::{HullLights, HullLightsInput},
    view::{HullInput, HullView},
};
pub use instanced_bvh::{
    ChangedMeshes, InstancedBvh, InstancedBvhBuilder, InstancedBvhInput, InstancedCounts,
};
pub use light::Light;
pub use multi_res_mask::{
    MultiResMask, MultiResMaskInput,
    settings::{MultiResLevel, MultiResMaskSettings},
    view::MultiResView,
};
pub use multi_res_reconstructor::{
    MultiResReconstructor, MultiResReconstructorInput, SubImages,
    settings::MultiResReconstructorSettings,
};
pub use near_field::{
    effect::NearFieldEffect,
    view::{NearFieldDescriptor, NearFieldInput, NearFieldSource, NearFieldView},
};
pub use ray_budget::{RayBudget, RayBudgetInput, settings::RayBudgetSettings, view::RayBudgetView};
pub use ray_traced::{
    bounces::{BounceSettings, Bounces},
    quality::{Quality, RaySettings, SplatQuality},
    scene::{RayTracedScene, RayTracedSceneInput},
    view::{RayTracedEffect, RayTracedInput, RayTracedView, RayTracedViewDescriptor},
};
pub use receivers::{Frame, FrameInput, GBufferDecoder, Receivers};
pub use reconstructor::{
    Reconstructor, ReconstructorInput, ReconstructorView, settings::ReconstructorSettings,
};
pub use reflective_shadow_map::{
    ReflectiveShadowMap, ReflectiveShadowMapInput, ReflectiveShadowMapView,
};
pub use screen_space_gi::{ScreenSpaceGi, ScreenSpaceGiInput, settings::ScreenSpaceGiSettings};
pub use sg_hull::{
    SgHull, SgHullDescriptor, SgHullInput,
    bound::GathererBinding,
    gatherer::{Gatherer, PolygonLight},
    params::{HullSegment, HullVertex, SgHullCounts},
    settings::{Components, SgHullSettings, SgHullSize},
    surfels::SurfelLight,
    view::SgHullView,
};
pub use shaders::shaders;
pub use shell_splatter::{
    ClusterInput, ShellSplatter, ShellSplatterDescriptor, SplatInput, SplatView, SurfelClusters,
    settings::SplatSettings,
};
pub use soft_shadows::{SoftShadows, SoftShadowsInput, settings::SoftShadowsSettings};
pub use surfel::{
    CloudCapacity, Piece, Placement, Surfel, SurfelCloud, SurfelCounts, SurfelRadiance,
    SurfelSource,
};
pub use surfel_gatherer::{
    SurfelGatherer, SurfelGathererInput, SurfelSenders, settings::SurfelGathererSettings,
};
pub use surfel_holes::{SurfelCutouts, SurfelHoles, SurfelHolesInput};
pub use surfel_shader::{
    ShadedLight, Shadow, ShadowMap, SurfelShader, SurfelShaderInput, settings::SurfelShaderSettings,
};
pub use surfelizer::{
    Surfelizer, SurfelizerInput,
    settings::{Reach, SurfelizerSettings},
};
pub use temporal_accumulator::{
    MotionVectors, TemporalAccumulator, TemporalHistory, TemporalInput, TemporalJoinInput,
    settings::TemporalSettings,
};
pub use texture_slice::TextureSlice;
pub use volumetric_obscurance::{
    ObscuranceInput, VolumetricObscurance, VolumetricObscuranceDescriptor,
    samples::{BallSamples, DiskSamples},
    settings::{Combine, ObscuranceSampling, ObscuranceSettings, ObscuranceVolume, SecondRadius},
};
pub use work::PixelList;
