//! One recording: what the caller gave, checked, and what stages bind of it.

use wgpu::{BindingResource, Buffer, CommandEncoder, Device, TextureView};

use super::{
    LABEL, SgHull, SgHullInput, bindings::Resource, bound::check_origin, modules::HullVariant,
    params::SgHullParams, settings::SgHullSettings, view::SgHullView,
};
use crate::{
    error::Error,
    gbuffer::check_roughness,
    gpu::{
        binding::{view, whole},
        check_timestamps, screen, uniform,
    },
    texture_slice::{TextureSlice, check_apart},
};

/// What all stages of one recording work on.
pub(super) struct Recording<'a> {
    pub device: &'a Device,
    pub input: &'a SgHullInput<'a>,
    pub settings: &'a SgHullSettings,
    pub hull: &'a SgHullView,
    params: Buffer,
    /// Each where the hull reads it.
    albedo: Option<TextureView>,
    roughness: Option<TextureView>,
}

impl Recording<'_> {
    /// What is bound as this. The textures are there for a hull that binds them.
    pub fn resource(&self, resource: Resource) -> Option<BindingResource<'_>> {
        let hull = self.hull;
        let buffer = match resource {
            Resource::Receivers => return Some(view(&hull.receivers.view)),
            Resource::Albedo => return self.albedo.as_ref().map(view),
            Resource::Roughness => return self.roughness.as_ref().map(view),
            Resource::Params => &self.params,
            Resource::SegmentOf => &hull.segment_of,
            Resource::Others => &hull.others,
            Resource::Segments => &hull.segments,
            Resource::Vertices => &hull.vertices,
            Resource::List => &hull.list,
            Resource::Splits => &hull.splits,
            Resource::Parts => &hull.parts,
            Resource::Rejected => &hull.rejected,
            Resource::PerPixel => &hull.per_pixel,
            Resource::Counts => &hull.counts,
            Resource::Dispatch => &hull.dispatch,
        };
        Some(whole(buffer))
    }
}

impl SgHull {
    /// Checks the input, records its receivers and makes the parameters.
    pub(super) fn prepare<'a>(
        &self,
        device: &'a Device,
        encoder: &mut CommandEncoder,
        input: &'a SgHullInput<'a>,
        settings: &'a SgHullSettings,
        hull: &'a SgHullView,
    ) -> Result<Recording<'a>, Error> {
        let roughness = self.check(input, settings, hull)?;
        self.receivers.record(
            device,
            encoder,
            &input.gbuffer,
            input.camera,
            input.origin,
            &hull.receivers,
        );
        let split_room = if self.splitter.is_some() {
            hull.size.splits
        } else {
            0
        };
        let params =
            SgHullParams::new(settings, &hull.size, input.camera, input.origin, split_room);
        let albedo = input.gbuffer.albedo.filter(|_| self.variant.albedo);
        Ok(Recording {
            device,
            input,
            settings,
            hull,
            params: uniform(device, LABEL, &params),
            albedo: albedo.map(|slice| slice.read()),
            roughness: roughness.map(|slice| slice.read()),
        })
    }

    /// Checks the input; gives the roughness, where it is read.
    fn check<'a>(
        &self,
        input: &SgHullInput<'a>,
        settings: &SgHullSettings,
        hull: &SgHullView,
    ) -> Result<Option<TextureSlice<'a>>, Error> {
        const TARGET: &str = "SgHullInput::target";
        settings.validate()?;
        check_timestamps(input.timestamps)?;
        let viewport = input.camera.viewport();
        input.gbuffer.validate(viewport)?;
        screen::check_target(TARGET, &input.target, viewport, self.target)?;
        let mismatch = |name, found: String, needed: String| {
            Err(Error::Mismatch {
                name,
                found,
                needed,
            })
        };
        let HullVariant { albedo, glossy } = self.variant;
        if albedo && input.gbuffer.albedo.is_none() {
            return mismatch(
                "GBuffer",
                "no albedo".into(),
                "one, for SgHullDescriptor::albedo".into(),
            );
        }
        let roughness = check_roughness(
            "SgHullInput::roughness",
            input.roughness,
            glossy.then_some("SgHullDescriptor::glossy"),
            viewport,
        )?;
        let read = input.roughness.map(|r| ("SgHullInput::roughness", r, 1));
        check_apart(TARGET, &input.target, input.gbuffer.reads().chain(read))?;
        if self.bound != input.gather.is_some() {
            return mismatch(
                "SgHullInput::gather",
                if self.bound {
                    "nothing"
                } else {
                    "a bind group"
                }
                .into(),
                "what the gatherer's layout is for".into(),
            );
        }
        check_origin("SgHullInput::origin", input.origin)?;
        if let Some(gather) = input.gather {
            gather.check(&self.source, input.origin)?;
        }
        if hull.receivers.size != [viewport.width, viewport.height] {
            return mismatch(
                "SgHullView",
                format!("{:?} pixels", hull.receivers.size),
                format!("{:?} pixels", [viewport.width, viewport.height]),
            );
        }
        Ok(roughness)
    }
}
