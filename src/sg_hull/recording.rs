//! One recording: what the caller gave, checked, and what stages bind of it.

use std::cell::RefCell;

use wgpu::{CommandEncoder, Device, TextureView};

use super::{
    SgHull, SgHullInput, modules::HullVariant, params::SgHullParams, settings::SgHullSettings,
    view::SgHullView,
};
use crate::{
    error::Error,
    gpu::{
        binding::{Group, Groups, Layout, Resource, view, whole},
        check_timestamps, screen,
        uniforms::{Place, Uploaded},
    },
    texture_slice::{TextureSlice, check_apart},
};

/// What all stages of one recording work on.
pub(super) struct Recording<'a> {
    pub device: &'a Device,
    pub input: &'a SgHullInput<'a>,
    pub settings: &'a SgHullSettings,
    pub hull: &'a SgHullView,
    parameters: Uploaded,
    params: Place,
    /// Of stages that bind nothing of the caller's.
    groups: RefCell<Groups<'a>>,
    /// Each where the hull reads it.
    albedo: Option<TextureView>,
    roughness: Option<TextureView>,
}

impl Recording<'_> {
    /// What a stage binds, by the names that modules have for it.
    pub fn group(&self, layout: &Layout) -> Group {
        let named: Vec<_> = layout
            .names()
            .filter_map(|name| Some((name, self.resource(name)?)))
            .collect();
        let callers = ["albedo_texture", "roughness_texture"];
        if layout.names().any(|name| callers.contains(&name)) {
            layout.group(self.device, &named)
        } else {
            self.groups.borrow_mut().next(layout, &named)
        }
    }

    /// The textures are there for a hull that binds them.
    fn resource(&self, name: &str) -> Option<Resource<'_>> {
        let hull = self.hull;
        let buffer = match name {
            "params" => return Some(self.parameters.at(self.params)),
            "receivers" => return Some(view(&self.input.frame.receivers.view)),
            "albedo_texture" => return self.albedo.as_ref().map(view),
            "roughness_texture" => return self.roughness.as_ref().map(view),
            "segment_of" => &hull.segment_of,
            "others" => &hull.others,
            "segments" => &hull.segments,
            "vertices" => &hull.vertices,
            "list" => &hull.list,
            "splits" => &hull.splits,
            "parts" => &hull.parts,
            "rejected" => &hull.rejected,
            // Listed, written and drawn.
            "per_pixel" | "pixels" | "gathered" => &hull.per_pixel,
            "counters" => &hull.counts,
            "dispatch" => &hull.dispatch,
            _ => return None,
        };
        Some(whole(buffer))
    }
}

impl SgHull {
    /// Checks the input and makes the parameters.
    pub(super) fn prepare<'a>(
        &self,
        device: &'a Device,
        encoder: &mut CommandEncoder,
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
        let (parameters, params) = self.uniforms.upload_one(device, encoder, &params);
        Ok(Recording {
            device,
            input,
            settings,
            hull,
            parameters,
            params,
            groups: RefCell::new(hull.kept.groups(device)),
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
