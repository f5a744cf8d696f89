//! Parts of textures: what a view would not have told is right by construction, or refused.

use deep_screen_space::{
    Components, Effect, Gatherer, HitResolver, HitResolverDescriptor, HitResolverInput,
    HitResolverSettings, Light, ReconstructorInput, ReconstructorSettings, Sampling, ScreenSpaceGi,
    ScreenSpaceGiInput, ScreenSpaceGiSettings, SgHull, SgHullDescriptor, SgHullInput,
    SgHullSettings, SgHullSize, SgHullView, ShadowMap, SoftShadows, SoftShadowsInput,
    SoftShadowsSettings, TemporalAccumulator, TemporalInput, TemporalSettings, TextureSlice,
    reference::receivers::decode_albedo, wgpu::TextureUsages as Usages,
};

use super::*;
use support::testing::refusals::refused;

impl Lab {
    fn empty(
        &self,
        format: Format,
        [width, height]: [u32; 2],
        (layers, mips): (u32, u32),
        usage: Usages,
        view_formats: &[Format],
    ) -> wgpu::Texture {
        self.gpu.device.create_texture(&wgpu::TextureDescriptor {
            label: None,
            size: wgpu::Extent3d {
                width,
                height,
                depth_or_array_layers: layers,
            },
            mip_level_count: mips,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage,
            view_formats,
        })
    }

    /// The picture's own mean, which every kind of target takes.
    fn accumulate(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        gbuffer: GBuffer<'_>,
        picture: TextureSlice<'_>,
        target: TextureSlice<'_>,
        format: Format,
    ) -> Result<(), Error> {
        let device = &self.gpu.device;
        let channels = deep_screen_space::Channels::Three;
        let pass = TemporalAccumulator::new(device, channels, format).expect("pipelines");
        let mut history = pass.create_history(device, SIDE, SIDE).expect("a history");
        let mut decoded = self.decoded();
        let frame = decoded.record(encoder, gbuffer, &self.camera, self.camera.focus())?;
        let input = TemporalInput::new(&frame, &self.camera, picture, target);
        pass.record(
            device,
            encoder,
            &input,
            &TemporalSettings::default(),
            &mut history,
        )
    }
}

const PLAIN: (u32, u32) = (1, 1);
const SIZE: [u32; 2] = [SIDE; 2];

/// A depth with a stencil, a mip level, a layer of an array, a face of a cube: the crate makes the view.
#[test]
fn parts_of_a_gbuffer_are_read() {
    let lab = &*LAB;
    let mut encoder = lab.gpu.encoder();
    let e = &mut encoder;
    let usage = Usages::TEXTURE_BINDING | Usages::RENDER_ATTACHMENT;
    let target = lab.gpu.target(Format::Rgba16Float, SIDE, SIDE);
    let picture = lab.albedo.texture().into();
    let record = |e: &mut wgpu::CommandEncoder, depth: TextureSlice<'_>| {
        let gbuffer = GBuffer {
            depth,
            ..lab.gbuffer()
        };
        lab.accumulate(
            e,
            gbuffer,
            picture,
            target.texture().into(),
            Format::Rgba16Float,
        )
    };
    let stencil = lab.empty(Format::Depth24PlusStencil8, SIZE, PLAIN, usage, &[]);
    record(e, (&stencil).into()).expect("the depth of it");
    let mips = lab.empty(Format::Depth32Float, [4 * SIDE; 2], (6, 3), usage, &[]);
    let mips = TextureSlice::new(&mips);
    record(e, mips.mip(2).layer(5)).expect("a face of the size");
    let shape = "Shape";
    refused(
        record(e, mips.mip(3)),
        shape,
        "GBuffer::depth",
        "mip level 3 of 3",
    );
    refused(
        record(e, mips.layer(6)),
        shape,
        "GBuffer::depth",
        "from 6 on, of 6",
    );
    refused(
        record(e, mips.layer(u32::MAX)),
        shape,
        "GBuffer::depth",
        "of 6",
    );
    refused(
        record(e, mips.mip(40)),
        shape,
        "GBuffer::depth",
        "mip level 40",
    );
    let small = lab.empty(Format::Depth32Float, SIZE, (1, 2), usage, &[]);
    let small = TextureSlice::new(&small);
    refused(record(e, small.mip(1)), "Size", "GBuffer::depth", "4x4");
    let volume = lab.gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d {
            width: SIDE,
            height: SIDE,
            depth_or_array_layers: 2,
        },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D3,
        format: Format::R32Float,
        usage: Usages::TEXTURE_BINDING,
        view_formats: &[],
    });
    refused(record(e, (&volume).into()), shape, "GBuffer::depth", "2-D");
    submit(lab, encoder);
}

/// Targets of several mips and layers, and one seen with sRGB.
#[test]
fn parts_of_a_target_are_written() {
    let lab = &*LAB;
    let mut encoder = lab.gpu.encoder();
    let e = &mut encoder;
    let usage = Usages::RENDER_ATTACHMENT | Usages::COPY_SRC | Usages::STORAGE_BINDING;
    let srgb = Format::Rgba8UnormSrgb;
    let target = lab.empty(Format::Rgba8Unorm, [2 * SIDE; 2], (3, 2), usage, &[srgb]);
    let part = TextureSlice::new(&target).mip(1).layer(2);
    let name = "TemporalInput::target";
    let record = |e: &mut wgpu::CommandEncoder, target, format| {
        lab.accumulate(
            e,
            lab.gbuffer(),
            lab.albedo.texture().into(),
            target,
            format,
        )
    };
    refused(record(e, part, srgb), "Mismatch", name, "Rgba8UnormSrgb");
    let wrong = part.seen_as(Format::Bgra8Unorm);
    refused(record(e, wrong, Format::Bgra8Unorm), "Format", name, "sRGB");
    refused(record(e, part.mip(2), srgb), "Shape", name, "mip level");
    record(e, part.seen_as(srgb), srgb).expect("a picture with sRGB");
    submit(lab, encoder);
    let read = |layer| -> Vec<[u8; 4]> {
        let texture = &target;
        let size = wgpu::Extent3d {
            width: SIDE,
            height: SIDE,
            depth_or_array_layers: 1,
        };
        let staging = lab.gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: u64::from(256 * SIDE),
            usage: BufferUsages::COPY_DST | BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        });
        let mut encoder = lab.gpu.encoder();
        encoder.copy_texture_to_buffer(
            wgpu::TexelCopyTextureInfo {
                mip_level: 1,
                origin: wgpu::Origin3d {
                    x: 0,
                    y: 0,
                    z: layer,
                },
                ..texture.as_image_copy()
            },
            wgpu::TexelCopyBufferInfo {
                buffer: &staging,
                layout: wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(256),
                    rows_per_image: None,
                },
            },
            size,
        );
        lab.gpu.finish(encoder);
        lab.gpu.read_buffer(&staging)
    };
    // 0.5 in sRGB is 188 of 255.
    assert!((187..=188).contains(&read(2)[0][0]), "{:?}", read(2)[0]);
    assert_eq!(read(1)[0], [0; 4]);
}

/// A plain map, a layer of an array and the six faces of a cube.
#[test]
fn shadow_maps_are_what_callers_have() {
    let lab = &*LAB;
    let device = &lab.gpu.device;
    let pass = SoftShadows::new(device).expect("pipelines");
    let mut encoder = lab.gpu.encoder();
    let usage = Usages::TEXTURE_BINDING | Usages::RENDER_ATTACHMENT;
    let light = Light::Point {
        position: DVec3::ZERO,
        intensity: [1.0; 3],
    };
    let cameras = [lab.camera; 6];
    let target = lab.gpu.storage(Format::R32Float, SIDE, SIDE);
    let mut record = |map: ShadowMap<'_>| {
        let input = SoftShadowsInput {
            gbuffer: lab.gbuffer(),
            camera: &lab.camera,
            light: &light,
            map,
            work: None,
            target: target.texture().into(),
            timestamps: None,
        };
        pass.record(
            device,
            &mut encoder,
            &input,
            &SoftShadowsSettings::default(),
        )
    };
    let plain = lab.empty(Format::Depth32Float, SIZE, PLAIN, usage, &[]);
    let cube = lab.empty(Format::Depth24PlusStencil8, SIZE, (6, 1), usage, &[]);
    let cascades = lab.empty(Format::Depth16Unorm, SIZE, (4, 1), usage, &[]);
    record(ShadowMap::new(&plain, &cameras[..1])).expect("a plain map");
    record(ShadowMap::new(&cube, &cameras)).expect("a cube");
    let cascades = TextureSlice::new(&cascades);
    record(ShadowMap::new(cascades.layer(3), &cameras[..1])).expect("a layer");
    record(ShadowMap::new(cascades.layer(1), &cameras[..3])).expect("some layers");
    refused(
        record(ShadowMap::new(cascades.layer(2), &cameras[..3])),
        "Shape",
        "ShadowMap::depth",
        "3 layers from 2 on, of 4",
    );
    submit(lab, encoder);
}

/// wgpu has no texture both read and written in one pass; and who reads what was just overwritten reads nonsense.
#[test]
fn targets_are_none_of_the_inputs() {
    let lab = &*LAB;
    let device = &lab.gpu.device;
    let mut encoder = lab.gpu.encoder();
    let usage = Usages::TEXTURE_BINDING | Usages::RENDER_ATTACHMENT | Usages::STORAGE_BINDING;
    let layers = lab.empty(Format::Rgba16Float, SIZE, (2, 1), usage, &[]);
    let depth = lab.empty(Format::R32Float, SIZE, PLAIN, usage, &[]);
    let [first, second] = [0, 1].map(|layer| TextureSlice::new(&layers).layer(layer));

    let pass = ScreenSpaceGi::new(device).expect("pipelines");
    let mut gi = |lit, target| {
        let input = ScreenSpaceGiInput {
            gbuffer: lab.gbuffer(),
            camera: &lab.camera,
            lit,
            work: None,
            target,
            timestamps: None,
        };
        pass.record(
            device,
            &mut encoder,
            &input,
            &ScreenSpaceGiSettings::default(),
        )
    };
    refused(
        gi(first, first),
        "Mismatch",
        "ScreenSpaceGiInput::target",
        "ScreenSpaceGiInput::lit",
    );
    gi(first, second).expect("another layer");

    let shadows = SoftShadows::new(device).expect("pipelines");
    let map = lab.empty(
        Format::Depth32Float,
        SIZE,
        PLAIN,
        usage - Usages::STORAGE_BINDING,
        &[],
    );
    let light = Light::Directional {
        direction: DVec3::NEG_Z,
        irradiance: [1.0; 3],
    };
    let cameras = [lab.camera];
    let input = SoftShadowsInput {
        gbuffer: GBuffer {
            depth: (&depth).into(),
            ..lab.gbuffer()
        },
        camera: &lab.camera,
        light: &light,
        map: ShadowMap::new(&map, &cameras),
        work: None,
        target: (&depth).into(),
        timestamps: None,
    };
    let settings = SoftShadowsSettings::default();
    let recorded = shadows.record(device, &mut encoder, &input, &settings);
    refused(
        recorded,
        "Mismatch",
        "SoftShadowsInput::target",
        "GBuffer::depth",
    );

    let gatherer = Gatherer::lights(device);
    let descriptor = SgHullDescriptor {
        gatherer: &gatherer,
        target: Format::Rgba16Float,
        albedo: true,
        glossy: false,
        components: Components::default(),
    };
    let hull = SgHull::new(device, &descriptor).expect("pipelines");
    let view = hull
        .create_view(device, SgHullSize::new(SIDE, SIDE))
        .expect("a view");
    let gather = gatherer
        .bind_lights(device, &[], lab.camera.eye())
        .expect("lights");
    let gbuffer = GBuffer {
        albedo: Some(first),
        ..lab.gbuffer()
    };
    let mut decoded = lab.decoded();
    let frame = decoded.frame(&mut encoder, gbuffer, &lab.camera, lab.camera.eye());
    let input = SgHullInput::new(&frame, Some(&gather), first);
    let settings = SgHullSettings::default();
    let recorded = hull.record(device, &mut encoder, &input, &settings, &view);
    refused(
        recorded,
        "Mismatch",
        "SgHullInput::target",
        "GBuffer::albedo",
    );
    submit(lab, encoder);
}

/// What the albedo holds that is no share of light comes out of no pass: the picture is that of white surfaces times what counts
/// of it.
#[test]
fn albedo_that_is_not_finite_is_black() {
    let lab = &*LAB;
    let texels: Vec<[f32; 4]> = (0..SIDE * SIDE)
        .map(|i| match i % 5 {
            0 => [f32::NAN, 0.5, 0.5, 0.0],
            1 => [f32::INFINITY, 0.5, 0.5, 0.0],
            2 => [f32::NEG_INFINITY, 0.5, 0.5, 0.0],
            3 => [-1.0, 0.5, 2.0, 0.0],
            _ => [0.25, 0.5, 1.0, 0.0],
        })
        .collect();
    let texture = |texels: &[[f32; 4]]| lab.gpu.texture(Format::Rgba32Float, SIDE, SIDE, texels);
    let (albedo, white) = (texture(&texels), texture(&vec![[1.0; 4]; texels.len()]));
    let check = |name: &str, picture: &dyn Fn(GBuffer<'_>) -> Vec<[f32; 4]>| {
        let [found, bright] = [&albedo, &white].map(|albedo| {
            picture(GBuffer {
                albedo: Some(albedo.texture().into()),
                ..lab.gbuffer()
            })
        });
        assert!(bright.iter().all(|v| v[0] > 0.1), "{name}: {:?}", bright[0]);
        for ((found, bright), texel) in found.iter().zip(&bright).zip(&texels) {
            let [r, g, b, _] = texel.map(f64::from);
            let share = decode_albedo(DVec3::new(r, g, b)).as_vec3().to_array();
            for k in 0..3 {
                assert_eq!(found[k], bright[k] * share[k], "{name}: of {texel:?}");
            }
        }
    };
    check("hull", &|gbuffer| {
        hull_picture(lab, gbuffer, SgHull::record)
    });
    check("hull per pixel", &|gbuffer| {
        hull_picture(lab, gbuffer, SgHull::record_per_pixel)
    });
    check("hits", &|gbuffer| hits_picture(lab, gbuffer));
    check("sums", &|gbuffer| sums_picture(lab, gbuffer));
}

type RecordHull = fn(
    &SgHull,
    &wgpu::Device,
    &mut wgpu::CommandEncoder,
    &SgHullInput<'_>,
    &SgHullSettings,
    &SgHullView,
) -> Result<(), Error>;

/// The wall lit from before it.
fn hull_picture(lab: &Lab, gbuffer: GBuffer<'_>, record: RecordHull) -> Vec<[f32; 4]> {
    let device = &lab.gpu.device;
    let gatherer = Gatherer::lights(device);
    let descriptor = SgHullDescriptor {
        gatherer: &gatherer,
        target: Format::Rgba32Float,
        albedo: true,
        glossy: false,
        components: Components::default(),
    };
    let hull = SgHull::new(device, &descriptor).expect("pipelines");
    let size = SgHullSize::new(SIDE, SIDE);
    let view = hull.create_view(device, size).expect("a view");
    let lights = [Light::Directional {
        direction: DVec3::NEG_Z,
        irradiance: [1.0; 3],
    }];
    let gather = gatherer.bind_lights(device, &lights, lab.camera.eye());
    let target = lab.gpu.target(Format::Rgba32Float, SIDE, SIDE);
    let mut encoder = lab.gpu.encoder();
    let mut decoded = lab.decoded();
    let frame = decoded.frame(&mut encoder, gbuffer, &lab.camera, lab.camera.eye());
    let gather = gather.expect("lights");
    let input = SgHullInput::new(&frame, Some(&gather), target.texture());
    let settings = SgHullSettings::default();
    record(&hull, device, &mut encoder, &input, &settings, &view).expect("a picture");
    lab.gpu.finish(encoder);
    lab.gpu.read_texture(target.texture(), 0)
}

/// The wall under a bright sky.
fn hits_picture(lab: &Lab, gbuffer: GBuffer<'_>) -> Vec<[f32; 4]> {
    let target = lab.gpu.target(Format::Rgba32Float, SIDE, SIDE);
    draw_hits(lab, gbuffer, 1.0, &target);
    lab.gpu.read_texture(target.texture(), 0)
}

fn draw_hits(lab: &Lab, gbuffer: GBuffer<'_>, sky: f32, target: &wgpu::TextureView) {
    let device = &lab.gpu.device;
    let mut encoder = lab.gpu.encoder();
    let cloud = lab.recorded(&mut encoder, ROOM);
    let bounds = lab.bvh(&cloud);
    lab.record_bvh(&mut encoder, &cloud, &bounds)
        .expect("a hierarchy");
    let hits = lab.hits(&lab.lit);
    let traced = BouncedSettings {
        rays_per_pixel: 4,
        sky_radiance: [sky; 3],
        ..BouncedSettings::default()
    };
    let mut decoded = lab.decoded();
    let frame = decoded.frame(&mut encoder, gbuffer, &lab.camera, cloud.origin());
    let input = BouncedInput {
        radiance: HitRadiance::Lit(HitLighting {
            materials: &lab.materials,
            lights: &[],
        }),
        ..BouncedInput::new(&frame, &cloud, &bounds)
    };
    lab.lit
        .record(device, &mut encoder, &input, &traced, &hits)
        .expect("hits");
    let descriptor = HitResolverDescriptor {
        payload: Payload::Radiance,
        sampling: Sampling::default(),
        deferred: false,
        counted: false,
        joined: false,
        bent_normals: false,
        emitter_samples: 0,
        target: target.texture().format(),
    };
    let pass = HitResolver::new(device, &descriptor).expect("pipelines");
    let scratch = pass.create_view(device, &hits).expect("a view");
    let input = HitResolverInput::new(&frame, &hits, target.texture());
    let settings = HitResolverSettings::default();
    pass.record(device, &mut encoder, &input, &settings, &scratch)
        .expect("a picture");
    lab.gpu.finish(encoder);
}

/// An effect that shows the albedo.
fn sums_picture(lab: &Lab, gbuffer: GBuffer<'_>) -> Vec<[f32; 4]> {
    let target = lab.gpu.target(Format::Rgba32Float, SIDE, SIDE);
    draw_sums(lab, gbuffer, 1.0, &target);
    lab.gpu.read_texture(target.texture(), 0)
}

fn draw_sums(lab: &Lab, gbuffer: GBuffer<'_>, gain: f32, target: &wgpu::TextureView) {
    let device = &lab.gpu.device;
    let mut encoder = lab.gpu.encoder();
    let cloud = lab.recorded(&mut encoder, ROOM);
    let mut clusters = lab.clusters(&cloud);
    lab.record_clusters(&mut encoder, &cloud, &mut clusters)
        .expect("clusters");
    let occlusion = AmbientOcclusion::default().effect();
    let (kept, _) = occlusion
        .source
        .split_once("fn resolve")
        .expect("its last function");
    let effect = Effect {
        source: format!(
            "{kept}fn resolve(sum: f32, albedo: vec3f) -> vec4f {{ return vec4f({gain:?} * albedo, 1.0); }}"
        )
        .into(),
        albedo: true,
        ..occlusion
    };
    let descriptor = ShellSplatterDescriptor {
        effect: &effect,
        subgroups: false,
        statistics: false,
    };
    let splatter = ShellSplatter::new(device, &descriptor).expect("pipelines");
    let sums = lab.splat_view();
    let mut decoded = lab.decoded();
    let frame = decoded.frame(&mut encoder, gbuffer, &lab.camera, cloud.origin());
    let input = SplatInput::new(&frame, &cloud, &clusters);
    splatter
        .record(device, &mut encoder, &input, &splat(), &sums)
        .expect("sums");
    let pass = splatter.reconstructor(device, target.texture().format());
    let pass = pass.expect("pipelines");
    let scratch = pass.create_view(device, &sums).expect("a view");
    let input = ReconstructorInput::new(&frame, &sums, target.texture());
    let settings = ReconstructorSettings::default();
    pass.record(device, &mut encoder, &input, &settings, &scratch)
        .expect("a picture");
    lab.gpu.finish(encoder);
}

/// Brighter than a half can be, which some drivers make no number of: it is the brightest half.
#[test]
fn halves_hold_the_brightest() {
    let lab = &*LAB;
    let white = lab.gpu.texture(
        Format::Rgba32Float,
        SIDE,
        SIDE,
        &vec![[1.0_f32; 4]; (SIDE * SIDE) as usize],
    );
    let gbuffer = GBuffer {
        albedo: Some(white.texture().into()),
        ..lab.gbuffer()
    };
    let bright = lab.gpu.texture(
        Format::Rgba32Float,
        SIDE,
        SIDE,
        &vec![[1e9_f32; 4]; (SIDE * SIDE) as usize],
    );
    let check = |name: &str, draw: &dyn Fn(&wgpu::TextureView)| {
        let target = lab.gpu.target(Format::Rgba16Float, SIDE, SIDE);
        draw(&target);
        let texels: Vec<[u16; 4]> = lab.gpu.read_texture(target.texture(), 0);
        for texel in texels {
            assert_eq!(texel[..3], [0x7bff; 3], "{name}: {texel:x?}");
        }
    };
    check("hits", &|target| draw_hits(lab, gbuffer, 1e9, target));
    check("sums", &|target| draw_sums(lab, gbuffer, 1e9, target));
    check("frames", &|target| {
        let mut encoder = lab.gpu.encoder();
        let (picture, target) = (bright.texture().into(), target.texture().into());
        lab.accumulate(&mut encoder, gbuffer, picture, target, Format::Rgba16Float)
            .expect("a picture");
        submit(lab, encoder);
    });
}
