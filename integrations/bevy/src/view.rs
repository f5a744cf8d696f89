//! A camera's occlusion: its texture, and its recording.

use bevy::{
    camera::MainPassResolutionOverride,
    core_pipeline::prepass::ViewPrepassTextures,
    ecs::{
        component::Component,
        entity::Entity,
        query::QueryData,
        system::{Commands, Query, Res},
    },
    pbr::ScreenSpaceAmbientOcclusionResources,
    render::{
        camera::{ExtractedCamera, TemporalJitter},
        render_resource::{Texture, TextureDescriptor},
        renderer::{RenderContext, RenderDevice, ViewQuery},
        sync_world::MainEntity,
        texture::CachedTexture,
        view::ExtractedView,
    },
};
use deep_screen_space::{
    Camera, GBuffer, MotionVectors, NormalEncoding, RayTracedInput, RayTracedView, Viewport,
    glam::DMat4,
};
use wgpu::{
    CommandEncoder, Device, Extent3d, TextureDimension, TextureFormat, TextureUsages,
    TextureViewDescriptor,
};

use crate::{
    error::Error, scene::Scene, settings::RayTracedAmbientOcclusion, status::RayTracingStatus,
};

/// What a camera is drawn with.
#[derive(QueryData)]
pub struct Seen {
    view: &'static ExtractedView,
    jitter: Option<&'static TemporalJitter>,
    resolution: Option<&'static MainPassResolutionOverride>,
}

impl SeenItem<'_, '_> {
    /// Whether Bevy's motion vectors, which are without jitter, are not those of the picture.
    fn is_jittered(&self) -> bool {
        self.jitter.is_some()
    }

    /// The camera, as Bevy's prepass draws with it.
    pub fn camera(&self) -> Result<Camera, Error> {
        let view = self.view;
        let [x, y, width, height] = view.viewport.to_array();
        let [width, height] = self
            .resolution
            .map_or([width, height], |size| size.0.to_array());
        let mut projection = view.clip_from_view;
        if let Some(jitter) = self.jitter {
            let size = bevy::math::UVec2::from([width, height]).as_vec2();
            jitter.jitter_projection(&mut projection, size);
        }
        // Inverted in f64: far from the world's origin f32 would lose the eye's place.
        let wide = |m: bevy::math::Mat4| {
            DMat4::from_cols_array_2d(&m.to_cols_array_2d().map(|column| column.map(f64::from)))
        };
        let world_from_view = wide(view.world_from_view.to_matrix());
        let viewport = Viewport {
            x,
            y,
            width,
            height,
        };
        Ok(Camera::new(
            world_from_view.inverse(),
            wide(projection),
            viewport,
        )?)
    }
}

/// A camera's textures, and the passes that write them.
#[derive(Component)]
pub struct Occlusion {
    settings: RayTracedAmbientOcclusion,
    view: Result<RayTracedView, Error>,
    /// Whether the next frame follows none.
    is_first: bool,
    /// Where rays write, at the places of the prepass.
    target: Texture,
    /// What materials read, whose first pixel is the viewport's: the same, unless that lies elsewhere.
    pub read: CachedTexture,
}

impl Occlusion {
    fn new(device: &RenderDevice, settings: RayTracedAmbientOcclusion, extent: Extent) -> Self {
        let (target, read) = textures(device, extent);
        Self {
            settings,
            view: make(device, &settings, extent.format),
            is_first: true,
            target,
            read,
        }
    }

    /// What moved meanwhile is not followed.
    pub fn forget_frames(&mut self) {
        self.is_first = true;
    }

    fn fits(&self, extent: Extent) -> bool {
        let is_shared = self.read.texture.id() == self.target.id();
        self.target.size() == extent.target
            && is_shared == extent.is_at_origin
            && (is_shared || self.read.texture.size() == extent.viewport)
    }

    /// Takes up other settings, compiling as little as they need.
    fn change(&mut self, device: &RenderDevice, settings: &RayTracedAmbientOcclusion) {
        let frames = self.settings.frames;
        self.settings = *settings;
        match &mut self.view {
            Ok(view) if frames == settings.frames => {
                let changed = view.set_effect(settings.effect());
                if let Err(error) = changed.and_then(|()| view.set_rays(settings.rays())) {
                    self.view = Err(error.into());
                }
            }
            _ => self.view = make(device, settings, self.target.format()),
        }
    }

    fn record(
        &mut self,
        (device, encoder): (&Device, &mut CommandEncoder),
        scene: &Scene,
        seen: &SeenItem<'_, '_>,
        textures: Option<&ViewPrepassTextures>,
    ) -> Result<(), Error> {
        let view = self.view.as_mut().map_err(|error| error.clone())?;
        let camera = seen.camera()?;
        let scene = scene.recorded()?;
        let depth = textures.and_then(|textures| textures.depth.as_ref());
        let depth = depth.ok_or(Error::Prepass("DepthPrepass"))?;
        let normal = textures.and_then(|textures| textures.normal.as_ref());
        let normal = normal.ok_or(Error::Prepass("NormalPrepass"))?;
        let motion = textures.and_then(|textures| textures.motion_vectors.as_ref());
        let Some(scene) = scene else {
            return Ok(());
        };
        let gbuffer = GBuffer {
            normal_encoding: NormalEncoding::Unsigned,
            ..GBuffer::new(&*depth.texture.texture, &*normal.texture.texture)
        };
        let input = RayTracedInput {
            reset: self.is_first,
            motion: motion
                .filter(|_| !seen.is_jittered())
                .map(|motion| MotionVectors::uv(&*motion.texture.texture)),
            ..RayTracedInput::new(gbuffer, &camera, &*self.target)
        };
        view.record(device, encoder, scene, &input)?;
        self.is_first = false;
        if self.read.texture.id() != self.target.id() {
            let Viewport { x, y, .. } = camera.viewport();
            let mut from = self.target.as_image_copy();
            from.origin = wgpu::Origin3d { x, y, z: 0 };
            let to = self.read.texture.as_image_copy();
            encoder.copy_texture_to_texture(from, to, self.read.texture.size());
        }
        Ok(())
    }
}

/// Of what format and how large a camera's textures are.
#[derive(Clone, Copy)]
struct Extent {
    format: TextureFormat,
    target: Extent3d,
    viewport: Extent3d,
    is_at_origin: bool,
}

fn make(
    device: &RenderDevice,
    settings: &RayTracedAmbientOcclusion,
    format: TextureFormat,
) -> Result<RayTracedView, Error> {
    let descriptor = settings.descriptor(format);
    Ok(RayTracedView::new(device.wgpu_device(), &descriptor)?)
}

/// What rays write, and what materials read.
fn textures(device: &RenderDevice, extent: Extent) -> (Texture, CachedTexture) {
    let texture = |size, usage| texture(device, extent.format, size, usage);
    let target = texture(extent.target, TextureUsages::COPY_SRC);
    let texture = if extent.is_at_origin {
        target.clone()
    } else {
        texture(extent.viewport, TextureUsages::COPY_DST)
    };
    let default_view = texture.create_view(&TextureViewDescriptor::default());
    let read = CachedTexture {
        texture,
        default_view,
    };
    (target, read)
}

fn texture(
    device: &RenderDevice,
    format: TextureFormat,
    size: Extent3d,
    usage: TextureUsages,
) -> Texture {
    device.create_texture(&TextureDescriptor {
        label: Some("deep-screen-space-bevy occlusion"),
        size,
        mip_level_count: 1,
        sample_count: 1,
        dimension: TextureDimension::D2,
        format,
        // Bevy's own passes write it, and get it bound though they do not run.
        usage: usage
            | TextureUsages::RENDER_ATTACHMENT
            | TextureUsages::STORAGE_BINDING
            | TextureUsages::TEXTURE_BINDING,
        view_formats: &[],
    })
}

/// Makes each camera's textures and passes, or takes up its settings.
pub fn prepare_occlusion(
    mut commands: Commands,
    device: Res<RenderDevice>,
    cameras: Query<(
        Entity,
        &ExtractedCamera,
        &ExtractedView,
        &RayTracedAmbientOcclusion,
        &ScreenSpaceAmbientOcclusionResources,
        Option<&mut Occlusion>,
    )>,
) {
    for (entity, camera, view, settings, bevys, occlusion) in cameras {
        let Some(target) = camera.physical_target_size else {
            continue;
        };
        let extent = |[width, height]: [u32; 2]| Extent3d {
            width,
            height,
            depth_or_array_layers: 1,
        };
        let [x, y, width, height] = view.viewport.to_array();
        if width == 0 || height == 0 {
            continue;
        }
        let extent = Extent {
            format: bevys
                .screen_space_ambient_occlusion_texture
                .texture
                .format(),
            target: extent(target.to_array()),
            viewport: extent([width, height]),
            is_at_origin: [x, y] == [0, 0],
        };
        let Some(mut occlusion) = occlusion else {
            let occlusion = Occlusion::new(&device, *settings, extent);
            commands.entity(entity).insert(occlusion);
            continue;
        };
        if !occlusion.fits(extent) {
            // The passes stay: to compile them takes longer than a window's edge is dragged.
            (occlusion.target, occlusion.read) = textures(&device, extent);
        }
        if !occlusion.settings.is(settings) {
            occlusion.change(&device, settings);
        }
    }
}

/// Records a camera's occlusion between its prepass and what reads it.
pub fn record_occlusion(
    camera: ViewQuery<(
        MainEntity,
        Seen,
        Option<&ViewPrepassTextures>,
        &mut Occlusion,
    )>,
    scene: Res<Scene>,
    status: Res<RayTracingStatus>,
    mut context: RenderContext,
) {
    let (entity, seen, textures, mut occlusion) = camera.into_inner();
    let device = context.render_device().wgpu_device().clone();
    let new_encoder = || {
        device.create_command_encoder(&wgpu::CommandEncoderDescriptor {
            label: Some("deep-screen-space-bevy occlusion"),
        })
    };
    let mut encoder = new_encoder();
    let result = occlusion.record((&device, &mut encoder), &scene, &seen, textures);
    if result.is_err() {
        // What was recorded is dropped, and nothing occludes.
        encoder = new_encoder();
        open(&mut encoder, &occlusion.read);
    }
    context.add_command_buffer(encoder.finish());
    status.set(entity, result);
}

/// Says that nothing occludes anywhere.
fn open(encoder: &mut CommandEncoder, occlusion: &CachedTexture) {
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some("deep-screen-space-bevy open"),
        color_attachments: &[Some(wgpu::RenderPassColorAttachment {
            view: &occlusion.default_view,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations {
                load: wgpu::LoadOp::Clear(wgpu::Color::WHITE),
                store: wgpu::StoreOp::Store,
            },
        })],
        ..Default::default()
    });
}
