//! One device for the tests of a binary, and the pipelines of each kind made once.
//!
//! Software drivers compile a pass in up to seconds, and most tests need the same few.

use std::{
    any::{Any, TypeId},
    collections::HashMap,
    fmt::Debug,
    sync::{Arc, LazyLock, Mutex, OnceLock, PoisonError},
};

use deep_screen_space::{
    BouncedDescriptor, BouncedZBuffer, BvhBuilder, Effect, GBufferDecoder, HitResolver,
    HitResolverDescriptor, MultiResMask, Primitives, Reconstructor, ScreenSpaceGi, ShellSplatter,
    ShellSplatterDescriptor, SoftShadows, SurfelShader, Surfelizer, wgpu::TextureFormat,
};

use crate::gpu::{Ask, Gpu};

static GPU: OnceLock<Gpu> = OnceLock::new();

/// The device that all tests share. Those that break theirs open one of their own.
pub fn gpu() -> &'static Gpu {
    gpu_or(|| Gpu::open(Ask::from_env()).expect("a graphics adapter; scripts/test.sh installs one"))
}

/// The same, for tests that need another kind: opened by the first of them.
pub fn gpu_or(open: impl FnOnce() -> Gpu) -> &'static Gpu {
    GPU.get_or_init(open)
}

type Slot = Arc<OnceLock<&'static (dyn Any + Send + Sync)>>;

/// What `make` made for the first caller who asked for a `T` with this key. Others wait for it, and only for it.
pub fn once<T: Any + Send + Sync>(key: &dyn Debug, make: impl FnOnce(&Gpu) -> T) -> &'static T {
    static MADE: LazyLock<Mutex<HashMap<(TypeId, String), Slot>>> = LazyLock::new(Mutex::default);
    let slot = MADE
        .lock()
        .unwrap_or_else(PoisonError::into_inner)
        .entry((TypeId::of::<T>(), format!("{key:?}")))
        .or_default()
        .clone();
    let made = slot.get_or_init(|| Box::leak(Box::new(make(gpu()))));
    made.downcast_ref().expect("the type is in the key")
}

pub fn decoder() -> &'static GBufferDecoder {
    once(&(), |gpu| {
        GBufferDecoder::new(&gpu.device).expect("pipelines")
    })
}

pub fn surfelizer() -> &'static Surfelizer {
    once(&(), |gpu| Surfelizer::new(&gpu.device).expect("pipelines"))
}

pub fn surfel_shader() -> &'static SurfelShader {
    once(&(), |gpu| {
        SurfelShader::new(&gpu.device).expect("pipelines")
    })
}

pub fn shell_splatter(effect: &Effect, subgroups: bool) -> &'static ShellSplatter {
    once(&(effect, subgroups), |gpu| {
        let descriptor = ShellSplatterDescriptor {
            effect,
            subgroups,
            statistics: false,
        };
        ShellSplatter::new(&gpu.device, &descriptor).expect("pipelines")
    })
}

pub fn reconstructor(effect: &Effect, target: TextureFormat) -> &'static Reconstructor {
    once(&(effect, target), |gpu| {
        Reconstructor::new(&gpu.device, effect, target).expect("pipelines")
    })
}

pub fn bounced(descriptor: &BouncedDescriptor) -> &'static BouncedZBuffer {
    once(descriptor, |gpu| {
        BouncedZBuffer::new(&gpu.device, descriptor).expect("pipelines")
    })
}

pub fn hit_resolver(descriptor: &HitResolverDescriptor) -> &'static HitResolver {
    once(descriptor, |gpu| {
        HitResolver::new(&gpu.device, descriptor).expect("pipelines")
    })
}

pub fn soft_shadows() -> &'static SoftShadows {
    once(&(), |gpu| SoftShadows::new(&gpu.device).expect("pipelines"))
}

pub fn screen_space_gi() -> &'static ScreenSpaceGi {
    once(&(), |gpu| {
        ScreenSpaceGi::new(&gpu.device).expect("pipelines")
    })
}

pub fn multi_res_mask() -> &'static MultiResMask {
    once(&(), |gpu| {
        MultiResMask::new(&gpu.device).expect("pipelines")
    })
}

pub fn bvh_builder(primitives: Primitives) -> &'static BvhBuilder {
    once(&primitives, |gpu| {
        BvhBuilder::new(&gpu.device, primitives).expect("pipelines")
    })
}
