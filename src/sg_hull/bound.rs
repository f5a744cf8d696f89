//! What a gatherer has bound, and what it was bound for.

use std::{borrow::Cow, sync::Arc};

use glam::DVec3;
use wgpu::{BindGroup, BindGroupEntry, Device};

use super::gatherer::Gatherer;
use crate::{
    error::Error,
    made,
    recorded::{Last, Stamp},
};

const NAME: &str = "SgHullInput::gather";

/// What a [`Gatherer`] has bound: from its functions `bind_…`. A hull takes what its own gatherer bound alone, for
/// the origin that positions were given for.
#[derive(Clone, Debug)]
pub struct GathererBinding {
    pub(super) group: BindGroup,
    /// The gatherer's.
    source: Cow<'static, str>,
    origin: Origin,
    /// The recording of the cloud whose surfels they are.
    cloud: Option<Stamp>,
}

/// What bound positions are relative to.
#[derive(Clone, Debug)]
pub(super) enum Origin {
    /// The caller knows.
    Unknown,
    At(DVec3),
    /// What a reflective shadow map is recorded for, each time.
    Map(Arc<Last<DVec3>>),
}

impl Gatherer {
    /// What a gatherer of the caller's own has bound, by its layout. Entries that do not fit it are wgpu's own validation
    /// error.
    ///
    /// # Errors
    /// [`Error::Mismatch`] for a gatherer without a layout.
    pub fn bind(
        &self,
        device: &Device,
        entries: &[BindGroupEntry<'_>],
    ) -> Result<GathererBinding, Error> {
        self.bound(device, entries, Origin::Unknown, None)
    }

    pub(super) fn bound(
        &self,
        device: &Device,
        entries: &[BindGroupEntry<'_>],
        origin: Origin,
        cloud: Option<Stamp>,
    ) -> Result<GathererBinding, Error> {
        let layout = self.layout.as_ref().ok_or_else(|| Error::Mismatch {
            name: "Gatherer",
            found: "no layout".into(),
            needed: "one, for what is bound".into(),
        })?;
        made::count(made::Kind::BindGroup);
        Ok(GathererBinding {
            group: device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("deep-screen-space gatherer"),
                layout,
                entries,
            }),
            source: self.source.clone(),
            origin,
            cloud,
        })
    }

    /// [`Error::Mismatch`] unless this is one of the crate's own, with this source.
    pub(super) fn check_kind(&self, source: &str, name: &'static str) -> Result<(), Error> {
        if self.source == source {
            return Ok(());
        }
        Err(Error::Mismatch {
            name: "Gatherer",
            found: format!("{:?}, with another source", self.label),
            needed: name.into(),
        })
    }
}

impl GathererBinding {
    /// That it is what this source binds, for positions relative to this origin.
    pub(super) fn check(&self, source: &str, origin: DVec3) -> Result<(), Error> {
        if self.source != source {
            return Err(Error::Mismatch {
                name: NAME,
                found: "another gatherer".into(),
                needed: "what the hull's own gatherer bound".into(),
            });
        }
        let at = match &self.origin {
            Origin::Unknown => origin,
            Origin::At(at) => *at,
            Origin::Map(map) => map.get("ReflectiveShadowMapView")?,
        };
        if at != origin {
            return Err(Error::Mismatch {
                name: NAME,
                found: format!("positions relative to {at}"),
                needed: format!("FrameInput::origin, {origin}"),
            });
        }
        match &self.cloud {
            Some(stamp) => stamp.check_last(NAME, "SurfelCloud"),
            None => Ok(()),
        }
    }
}
