//! Surfels of a scene splatted for an effect, and what it takes to hold the sums beside the mirror's.

use deep_screen_space::{
    CloudCapacity, ClusterInput, Effect, Environment, EnvironmentLight, Error, GBuffer, Geometry,
    Material, ReconstructorInput, ReconstructorSettings, ShellSplatter, SplatInput, SplatSettings,
    SplatView, Surfel, SurfelCounts, SurfelRadiance, SurfelSource, Surfelizer, SurfelizerInput,
    SurfelizerSettings, TextureSlice,
    glam::{DQuat, DVec3},
    reference::{
        effects::{Effect as Effects, Sender},
        packing::unpack_normal,
        reconstructor::{Reconstruction, Sum},
        shell_splatter::{Disk, Receiver, splat},
    },
    wgpu,
};

use super::{frames::Decoded, passes, pipelines, shot::Shot};
use crate::gpu::Gpu;

fn color(three: [f32; 3]) -> DVec3 {
    DVec3::from(three.map(f64::from))
}

/// What a run leaves.
pub struct Run {
    pub decoded: Decoded<'static>,
    pub view: SplatView,
    pub counts: SurfelCounts,
    pub surfels: Vec<Surfel>,
    pub sources: Vec<SurfelSource>,
    pub origin: DVec3,
}

pub struct Options {
    pub surfelizer: SurfelizerSettings,
    pub splat: SplatSettings,
    pub capacity: CloudCapacity,
    pub materials: Option<Vec<Material>>,
    /// As many as the cloud has room for.
    pub radiance: Option<Vec<SurfelRadiance>>,
    /// Of each pixel.
    pub roughness: Option<wgpu::TextureView>,
    /// And how it is turned.
    pub environment: Option<(Environment, DQuat)>,
}

impl Options {
    pub fn new(splat: SplatSettings) -> Self {
        Self {
            surfelizer: SurfelizerSettings {
                radius_pixels: 2.0,
                ..SurfelizerSettings::default()
            },
            splat,
            capacity: CloudCapacity {
                surfels: 1 << 16,
                pieces: 1 << 16,
                triangles: 1 << 16,
            },
            materials: None,
            radiance: None,
            roughness: None,
            environment: None,
        }
    }

    /// What a shot shows, with the roughness.
    fn gbuffer<'a>(&'a self, shot: &'a Shot) -> GBuffer<'a> {
        GBuffer {
            roughness: self.roughness.as_ref().map(|view| view.texture().into()),
            ..shot.lit_gbuffer()
        }
    }

    fn light(&self) -> Option<EnvironmentLight<'_>> {
        let (environment, rotation) = self.environment.as_ref()?;
        let rotation = *rotation;
        Some(EnvironmentLight {
            environment,
            rotation,
        })
    }
}

/// Pipelines, which take longer to compile than most tests to run.
pub struct Passes {
    pub surfelizer: &'static Surfelizer,
    pub splatter: &'static ShellSplatter,
}

impl Passes {
    pub fn new(effect: &Effect, subgroups: bool) -> Self {
        Self {
            surfelizer: pipelines::surfelizer(),
            splatter: pipelines::shell_splatter(effect, subgroups),
        }
    }
}

pub fn run(gpu: &Gpu, shot: &Shot, passes: &Passes, options: &Options) -> Run {
    try_run(gpu, shot, passes, options).expect("sums")
}

/// The same where the splatter may refuse it.
pub fn try_run(gpu: &Gpu, shot: &Shot, passes: &Passes, options: &Options) -> Result<Run, Error> {
    let device = &gpu.device;
    let Passes {
        surfelizer,
        splatter,
    } = passes;
    let viewport = shot.camera.viewport();
    let levels = options.splat.levels;
    let mut cloud = surfelizer
        .create_cloud(device, options.capacity)
        .expect("a cloud");
    let mut clusters = splatter
        .create_clusters(device, &cloud, levels)
        .expect("clusters");
    let view = splatter
        .create_view(device, viewport.width, viewport.height, levels)
        .expect("a view");
    let materials = options
        .materials
        .as_ref()
        .map(|m| gpu.buffer(m, wgpu::BufferUsages::STORAGE));
    let radiance = options
        .radiance
        .as_ref()
        .map(|r| gpu.buffer(r, wgpu::BufferUsages::STORAGE));
    let mut encoder = gpu.encoder();
    surfelizer
        .record(
            device,
            &mut encoder,
            &SurfelizerInput::new(
                Geometry {
                    meshes: &shot.buffers.meshes(),
                },
                &shot.camera,
            ),
            &options.surfelizer,
            &mut cloud,
        )
        .expect("surfels");
    splatter
        .record_clusters(
            device,
            &mut encoder,
            &ClusterInput {
                materials: materials.as_ref(),
                radiance: radiance.as_ref(),
                ..ClusterInput::new(&cloud)
            },
            &options.splat,
            &mut clusters,
        )
        .expect("clusters");
    let mut decoded = Decoded::of(&shot.camera);
    let gbuffer = options.gbuffer(shot);
    let frame = decoded.frame(&mut encoder, gbuffer, &shot.camera, cloud.origin());
    splatter.record(
        device,
        &mut encoder,
        &SplatInput {
            materials: materials.as_ref(),
            radiance: radiance.as_ref(),
            environment: options.light(),
            ..SplatInput::new(&frame, &cloud, &clusters)
        },
        &options.splat,
        &view,
    )?;
    gpu.finish(encoder);
    let counts: SurfelCounts = gpu.read_buffer(cloud.counters())[0];
    let stored = counts.stored as usize;
    Ok(Run {
        decoded,
        view,
        counts,
        surfels: gpu.read_buffer(cloud.surfels())[..stored].to_vec(),
        sources: gpu.read_buffer(cloud.sources())[..stored].to_vec(),
        origin: cloud.origin(),
    })
}

impl Run {
    pub fn disks(&self) -> Vec<Disk> {
        (self.surfels.iter().zip(&self.sources))
            .map(|(surfel, source)| Disk {
                position: color(surfel.position),
                sender: Sender::new(f64::from(surfel.radius), unpack_normal(source.normal)),
            })
            .collect()
    }

    /// With what the run's options gave besides.
    pub fn disks_of(&self, options: &Options) -> Vec<Disk> {
        let mut disks = self.disks();
        for (i, disk) in disks.iter_mut().enumerate() {
            let sender = &mut disk.sender;
            if let Some(materials) = &options.materials {
                sender.emission = color(materials[self.sources[i].material as usize].emission);
            }
            if let Some(radiance) = &options.radiance {
                (sender.front, sender.back) = (color(radiance[i].front), color(radiance[i].back));
            }
        }
        disks
    }

    pub fn receivers(&self, gpu: &Gpu) -> Vec<Option<Receiver>> {
        passes::receivers(gpu, &self.decoded)
    }

    pub fn sums(&self, gpu: &Gpu, level: u32) -> Vec<f32> {
        gpu.read_texture(self.view.sums().texture(), level)
    }

    pub fn total(&self, gpu: &Gpu, levels: u32) -> Vec<f32> {
        let mut total = self.sums(gpu, 0);
        for level in 1..levels {
            for (t, s) in total.iter_mut().zip(self.sums(gpu, level)) {
                *t += s;
            }
        }
        total
    }
}

impl Run {
    /// All outputs of an effect, of its sums.
    pub fn pictures(
        &self,
        gpu: &Gpu,
        shot: &Shot,
        effect: &Effect,
        options: &Options,
    ) -> Vec<Vec<[f32; 4]>> {
        const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Float;
        let device = &gpu.device;
        let reconstructor = pipelines::reconstructor(effect, FORMAT);
        let scratch = reconstructor.create_view(device, &self.view);
        let scratch = scratch.expect("a view");
        let viewport = shot.camera.viewport();
        let [right, bottom] = [viewport.x + viewport.width, viewport.y + viewport.height];
        let targets: Vec<_> = (effect.outputs.iter())
            .map(|_| gpu.target(FORMAT, right, bottom))
            .collect();
        let slices: Vec<TextureSlice<'_>> = targets.iter().map(|t| t.texture().into()).collect();
        let mut encoder = gpu.encoder();
        let mut decoded = Decoded::of(&shot.camera);
        let gbuffer = options.gbuffer(shot);
        let frame = decoded.frame(&mut encoder, gbuffer, &shot.camera, self.origin);
        let input = ReconstructorInput {
            further: &slices[1..],
            environment: options.light(),
            ..ReconstructorInput::new(&frame, &self.view, slices[0])
        };
        let settings = ReconstructorSettings::default();
        reconstructor
            .record(device, &mut encoder, &input, &settings, &scratch)
            .expect("pictures");
        gpu.finish(encoder);
        let within = |all: Vec<[f32; 4]>| {
            let rows = all.chunks_exact(right as usize).skip(viewport.y as usize);
            let rows = rows.map(|row| &row[viewport.x as usize..]);
            rows.flatten().copied().collect()
        };
        let pictures = targets.iter().map(|t| gpu.read_texture(t.texture(), 0));
        pictures.map(within).collect()
    }

    /// What all levels come to, of sums that `of` makes of their channels.
    pub fn totals<S: Sum>(
        &self,
        gpu: &Gpu,
        (shot, options): (&Shot, &Options),
        channels: usize,
        of: impl Fn(&[f64]) -> S,
    ) -> Vec<S> {
        let sums: Vec<Vec<S>> = (0..options.splat.levels)
            .map(|level| {
                let found = self.channels(gpu, level, channels);
                let at = |i: usize| -> Vec<f64> { found.iter().map(|c| c[i].into()).collect() };
                (0..found[0].len()).map(|i| of(&at(i))).collect()
            })
            .collect();
        Reconstruction {
            camera: &shot.camera,
            origin: self.origin,
            receivers: &self.receivers(gpu),
            settings: &ReconstructorSettings::default(),
        }
        .reconstruct(&sums)
    }
}

/// The usual ones otherwise.
pub fn splat_settings(levels: u32, epsilon: f32) -> SplatSettings {
    SplatSettings {
        levels,
        epsilon,
        ..SplatSettings::default()
    }
}

/// Largest error of a channel of a sum, relative to 1 where sums are small: f32 rounding of positions (1e-7 of the distance from
/// the eye, over a surfel's distance of a few pixels, 1e-2 of it) makes 1e-5 of a contribution near 1, and a few add up.
pub const TOLERANCE: f64 = 1e-4;

/// How many pixels may exceed it, and then by no more than the pairs come to that lie on the bound of a shell: rounding decides
/// which level sees those.
pub const EXCEPTIONS: f64 = 1e-2;

/// How far sums may be off the mirror's.
#[derive(Clone, Copy, Debug)]
pub struct Tolerance {
    /// Relative to 1 and the sum.
    pub rounding: f64,
    /// What those may be off besides that are further.
    pub most: f64,
    /// The share of the pixels that those may be.
    pub exceptions: f64,
}

impl Default for Tolerance {
    fn default() -> Self {
        Self {
            rounding: TOLERANCE,
            most: 0.0,
            exceptions: EXCEPTIONS,
        }
    }
}

impl Run {
    /// A level's sums, channel by channel.
    pub fn channels(&self, gpu: &Gpu, level: u32, count: usize) -> Vec<Vec<f32>> {
        let texture = self.view.sums().texture();
        let planes = count.div_ceil(4);
        let width = [1, 2, 4, 4][count.min(4) - 1];
        let plane = |i: usize| -> Vec<f32> {
            let layer = level * planes as u32 + i as u32;
            match width {
                1 => gpu.read_texture(texture, layer),
                2 => gpu.read_texture::<[f32; 2]>(texture, layer).concat(),
                _ => gpu.read_texture::<[f32; 4]>(texture, layer).concat(),
            }
        };
        let planes: Vec<_> = (0..planes).map(plane).collect();
        let of = |c: usize| planes[c / 4].iter().skip(c % 4).step_by(width).copied();
        (0..count).map(|c| of(c).collect()).collect()
    }

    /// Holds all levels beside the mirror of an effect, whose sums have these channels.
    #[track_caller]
    pub fn compare<E: Effects>(
        &self,
        gpu: &Gpu,
        (effect, options): (&E, &Options),
        channels: impl Fn(E::Sum) -> Vec<f64>,
        name: &str,
    ) {
        let tolerance = Tolerance::default();
        self.compare_within(gpu, (effect, options), channels, (name, tolerance));
    }

    /// The same with a tolerance of one's own.
    #[track_caller]
    pub fn compare_within<E: Effects>(
        &self,
        gpu: &Gpu,
        (effect, options): (&E, &Options),
        channels: impl Fn(E::Sum) -> Vec<f64>,
        (name, tolerance): (&str, Tolerance),
    ) {
        let disks = self.disks_of(options);
        let receivers = self.receivers(gpu);
        let size = self.view.size();
        let mut beyond = 0;
        for level in 0..options.splat.levels {
            // Squares of distances are off by some units of 2^-24 of the position's own square.
            let settings = &options.splat;
            let mirror = splat(effect, &disks, &receivers, size, level, settings, 2e-5);
            let count = channels(E::Sum::default()).len();
            let found = self.channels(gpu, level, count);
            for (i, sum) in mirror.iter().enumerate() {
                let at_a_bound = channels(sum.at_a_bound);
                // Of terms that may cancel each is as large as the largest channel's.
                let largest = at_a_bound
                    .iter()
                    .fold(0.0, |most, v: &f64| v.abs().max(most));
                let is_signed = at_a_bound.iter().any(|v| *v < 0.0);
                let expected = channels(sum.value);
                let mut worst = 0.0_f64;
                for (c, expected) in expected.iter().enumerate() {
                    let error = (f64::from(found[c][i]) - expected).abs();
                    let rounding = tolerance.rounding * (1.0 + expected.abs());
                    let moved = if is_signed { largest } else { at_a_bound[c] };
                    assert!(
                        error <= rounding + tolerance.most + 1.01 * moved,
                        "{name}: level {level}, pixel {i}, channel {c}: GPU {}, mirror {expected}, {} at a bound",
                        found[c][i],
                        at_a_bound[c]
                    );
                    worst = worst.max(error / rounding);
                }
                beyond += usize::from(worst > 1.0);
            }
        }
        println!(
            "{name}: {beyond} of {} pixels beyond {}",
            receivers.len(),
            tolerance.rounding
        );
        assert!(
            beyond as f64 <= tolerance.exceptions * receivers.len() as f64,
            "{name}: {beyond} pixels are off by more than {}",
            tolerance.rounding
        );
    }
}
