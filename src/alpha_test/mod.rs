//! Triangles with holes, where a picture of the caller's has little alpha (`wgsl/alpha_test.wgsl`, `wgsl/common/cutout.wgsl`,
//! `wgsl/common/map_alpha.wgsl`). What rays traverse holds the texture coordinates of such triangles, and the traversal asks the
//! picture where one would be met; of the others it asks nothing.

pub(crate) mod params;
pub(crate) mod settings;

use wgpu::{
    BufferUsages, ComputePass, ComputePipeline, Device, PipelineCache, TextureFormat,
    TextureUsages, TextureView, TextureViewDescriptor, TextureViewDimension,
};

use self::{
    params::{AlphaTestParams, CUTOUT_BYTES, CutParams},
    settings::{AlphaTest, AlphaTests},
};
use crate::{
    effect::Listing,
    error::{Error, check_limit},
    geometry::Geometry,
    gpu::{
        WORKGROUP,
        binding::{Group, Kept, Layout, Resource, part, whole},
        dispatch, shader, storage,
        texture::Plane,
        uniforms::{Parameters, Uniforms},
    },
    mesh_binding::{MeshBinding, Window, check_bound, windows},
    surfel::SurfelCloud,
};

const SOURCE: &str = include_str!("../../wgsl/alpha_test.wgsl");

const LABEL: &str = "deep-screen-space alpha test";

/// Room for the holes of so many primitives.
pub(crate) fn create_cutouts(device: &Device, capacity: u32) -> Result<wgpu::Buffer, Error> {
    storage(
        device,
        "deep-screen-space cutouts",
        CUTOUT_BYTES * u64::from(capacity.max(1)),
        BufferUsages::COPY_DST,
    )
}

/// The pictures as rays read them.
#[derive(Debug)]
pub(crate) struct AlphaMaps {
    view: TextureView,
    /// What it is a view of: texture, mip level, first layer, format.
    of: Option<(wgpu::Texture, u32, u32, TextureFormat)>,
}

impl AlphaMaps {
    /// None: a texel that nothing reads.
    pub fn none(device: &Device) -> Self {
        let usage = TextureUsages::TEXTURE_BINDING;
        let label = "deep-screen-space no alpha maps";
        let texture = Plane::new(label, TextureFormat::R8Unorm, [1, 1], usage).create(device);
        Self {
            view: texture.create_view(&TextureViewDescriptor {
                dimension: Some(TextureViewDimension::D2Array),
                ..Default::default()
            }),
            of: None,
        }
    }

    /// Takes the caller's, which were checked.
    pub fn set(&mut self, tests: &AlphaTests<'_>) {
        let maps = &tests.maps;
        let of = (
            maps.texture.clone(),
            maps.mip,
            maps.layer,
            maps.view_format(),
        );
        if self.of.as_ref() != Some(&of) {
            self.view = maps.read_layers(tests.layers());
            self.of = Some(of);
        }
    }

    pub fn view(&self) -> &TextureView {
        &self.view
    }
}

/// What is bound of a mesh's texture coordinates.
pub(crate) fn window_of(test: &AlphaTest<'_>, vertices: u32) -> Window {
    let coords = &test.tex_coords;
    Window::over(
        coords.offset,
        u64::from(vertices) * u64::from(coords.stride),
        coords.buffer.size(),
    )
}

/// Checks that the device can bind it.
pub(crate) fn check_window(device: &Device, window: Window) -> Result<(), Error> {
    check_limit(
        "max_storage_buffer_binding_size",
        device.limits().max_storage_buffer_binding_size,
        window.size,
        "AlphaTest::tex_coords",
    )
}

/// A window as a binding.
pub(crate) fn bound<'a>(test: &AlphaTest<'a>, window: Window) -> Resource<'a> {
    part(test.tex_coords.buffer, window.offset, window.size)
}

/// The pipeline.
#[derive(Debug)]
pub(crate) struct AlphaTestPass {
    layout: Layout,
    cut_pieces: ComputePipeline,
    uniforms: Uniforms,
}

/// Assembles the module.
fn source() -> Result<String, Error> {
    shader::assemble("alpha_test", SOURCE, &[], &[])
}

/// Dispatches that are ready to be recorded: a bind group, and how many workgroups.
pub(crate) type Cuts = Vec<(Group, u32)>;

impl AlphaTestPass {
    pub fn new(device: &Device, cache: Option<&PipelineCache>) -> Result<Self, Error> {
        let module = shader::create(device, LABEL, source()?);
        let (layout, cut_pieces) = module.kernel(device, "cut_pieces", &[], cache);
        Ok(Self {
            layout,
            cut_pieces,
            uniforms: Uniforms::new(LABEL),
        })
    }

    /// Checks all that may be refused of a cloud's holes; the caller calls the geometry `name`.
    pub fn check(
        device: &Device,
        name: &'static str,
        geometry: &Geometry<'_>,
        tests: &AlphaTests<'_>,
        cloud: &SurfelCloud,
    ) -> Result<(), Error> {
        for mesh in geometry.meshes {
            mesh.validate()?;
        }
        tests.validate(device, geometry.meshes)?;
        let triangles = geometry.triangles();
        if triangles > cloud.capacity.triangles {
            return Err(Error::Mismatch {
                name,
                found: format!("{triangles} triangles"),
                needed: format!("those of the cloud, up to {}", cloud.capacity.triangles),
            });
        }
        for (index, mesh) in geometry.meshes.iter().enumerate() {
            if let Some(test) = tests.of(index) {
                check_window(device, window_of(test, mesh.vertices.count))?;
                check_bound(device, &MeshBinding::new(mesh, 0))?;
            }
        }
        Ok(())
    }

    /// What is to be dispatched for a cloud's holes, checked.
    pub fn bind(
        &self,
        device: &Device,
        encoder: &mut wgpu::CommandEncoder,
        (geometry, tests): (&Geometry<'_>, &AlphaTests<'_>),
        cloud: &SurfelCloud,
        (cutouts, kept): (&wgpu::Buffer, &Kept),
    ) -> Cuts {
        let mut parameters = Parameters::new(device);
        let params = parameters.add(&CutParams::new(cloud.origin, cloud.capacity));
        let mut first_triangle = 0;
        let mut tested = Vec::new();
        for (index, mesh) in geometry.meshes.iter().enumerate() {
            let triangles = mesh.triangles() * mesh.instance_count();
            if let Some(test) = tests.of(index)
                && test.threshold > 0.0
                && mesh.vertices.count > 0
                && triangles > 0
            {
                let binding = MeshBinding::new(mesh, first_triangle);
                let window = window_of(test, mesh.vertices.count);
                let own = parameters.add(&binding.params);
                let alpha = parameters.add(&AlphaTestParams::new(tests, test, window));
                tested.push((mesh, binding, (test, window), [own, alpha], triangles));
            }
            first_triangle += triangles;
        }
        let parameters = self.uniforms.upload(device, encoder, &parameters);
        let mut groups = kept.groups(device);
        tested
            .iter()
            .map(|(mesh, binding, (test, window), [own, alpha], triangles)| {
                let [vertices, indices, transforms] = windows(mesh, binding);
                let resources = [
                    ("params", parameters.at(params)),
                    ("mesh", parameters.at(*own)),
                    ("alpha_test", parameters.at(*alpha)),
                    ("vertices", vertices),
                    ("indices", indices),
                    ("transforms", transforms),
                    ("tex_coords", bound(test, *window)),
                    ("triangle_offsets", whole(&cloud.triangle_offsets.values)),
                    ("pieces", whole(&cloud.pieces)),
                    ("cutouts", whole(cutouts)),
                ];
                let group = groups.next(&self.layout, &resources);
                (group, triangles.div_ceil(WORKGROUP))
            })
            .collect()
    }

    /// Records them.
    pub fn dispatch(&self, pass: &mut ComputePass<'_>, cuts: &Cuts) {
        for (group, workgroups) in cuts {
            dispatch(pass, &self.cut_pieces, group, *workgroups);
        }
    }
}

/// Every module of the pass.
pub(crate) fn list(all: &mut Listing<'_>) -> Result<(), Error> {
    all.add("alpha_test", source()?);
    Ok(())
}
