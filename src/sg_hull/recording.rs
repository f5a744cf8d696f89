//! One recording: what the caller gave, checked, and what stages bind of it.

use wgpu::{BindingResource, Buffer, Device, TextureView};

use super::{
    LABEL, SgHull, SgHullInput, bindings::Resource, modules::HullVariant, params::SgHullParams,
    settings::SgHullSettings, view::SgHullView,
};
use crate::{
    error::Error,
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
            Resource::Receivers => return Some(view(&self.input.frame.receivers.view)),
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
    /// Checks the input and makes the parameters.
    pub(super) fn prepare<'a>(
        &self,
        device: &'a Device,
        input: &'a SgHullInput<'a>,
        settings: &'a SgHullSettings,
        hull: &'a SgHullView,
    ) -> Result<Recording<'a>, Error> {
        self.check(input, settings, hull)?;
        let frame = input.frame;
        let split_room = if self.splitter.is_some() {
            hull.size.splits
        } else {
            0
        };
        let params = SgHullParams::new(
            settings,
            &hull.size,
            &frame.camera,
            frame.origin,
            split_room,
        );
        let HullVariant { albedo, glossy } = self.variant;
        let read = |slice: Option<TextureSlice<'_>>, wanted| {
            slice.filter(|_| wanted).map(|slice| slice.read())
        };
        Ok(Recording {
            device,
            input,
            settings,
            hull,
            params: uniform(device, LABEL, &params),
            albedo: read(frame.gbuffer.albedo, albedo),
            roughness: read(frame.gbuffer.roughness, glossy),
        })
    }

    fn check(
        &self,
        input: &SgHullInput<'_>,
        settings: &SgHullSettings,
        hull: &SgHullView,
    ) -> Result<(), Error> {
        const TARGET: &str = "SgHullInput::target";
        settings.validate()?;
        check_timestamps(input.timestamps)?;
        let frame = input.frame;
        let viewport = frame.viewport();
        screen::check_target(TARGET, &input.target, viewport, self.target)?;
        let HullVariant { albedo, glossy } = self.variant;
        if albedo {
            frame.gbuffer.albedo_for("SgHullDescriptor::albedo")?;
        }
        if glossy {
            frame.gbuffer.roughness_for("SgHullDescriptor::glossy")?;
        }
        check_apart(TARGET, &input.target, frame.gbuffer.reads())?;
        if self.bound != input.gather.is_some() {
            return Err(Error::Mismatch {
                name: "SgHullInput::gather",
                found: if self.bound {
                    "nothing"
                } else {
                    "a bind group"
                }
                .into(),
                needed: "what the gatherer's layout is for".into(),
            });
        }
        if let Some(gather) = input.gather {
            gather.check(&self.source, frame.origin)?;
        }
        let size = [viewport.width, viewport.height];
        let room = [hull.size.width, hull.size.height];
        if room != size {
            return Err(Error::Mismatch {
                name: "SgHullView",
                found: format!("{room:?} pixels"),
                needed: format!("{size:?} pixels"),
            });
        }
        Ok(())
    }
}
