//! Which pixels of one view have further rays.

use wgpu::Buffer;

use crate::{
    bounced_z_buffer::view::BouncedView, error::Error, gpu::binding::Kept, receivers::Place,
    recorded::Last,
};

/// Which pixels of one view have further rays, and how many.
#[derive(Debug)]
pub struct RayBudgetView {
    pub(super) size: [u32; 2],
    pub(super) cells: Buffer,
    pub(super) needs: Buffer,
    pub(super) state: Buffer,
    pub(super) work: Buffer,
    pub(super) dispatch: Buffer,
    pub(super) recorded: Last<Place>,
    pub(super) kept: Kept,
}

impl RayBudgetView {
    /// Width and height in pixels: that of the cameras' viewports.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Pairs of `u32`: first how many pixels are listed, and 0; then of each one, in any order, `x | y << 16`, and how many
    /// further sets of rays it has, as many rays each as
    /// [`BouncedSettings::rays_per_pixel`](crate::BouncedSettings::rays_per_pixel).
    /// Usages `STORAGE | COPY_SRC`.
    pub fn pixels(&self) -> &Buffer {
        &self.work
    }

    /// GPU memory that it owns, bytes: 12.5 per pixel, and 1 KiB.
    pub fn memory_bytes(&self) -> u64 {
        [
            &self.cells,
            &self.needs,
            &self.state,
            &self.work,
            &self.dispatch,
        ]
        .map(Buffer::size)
        .iter()
        .sum()
    }

    /// A workgroup for 64 pixels each.
    pub(crate) fn dispatch(&self) -> &Buffer {
        &self.dispatch
    }

    /// That it lists pixels of a view's frame.
    pub(crate) fn check(&self, view: &BouncedView) -> Result<(), Error> {
        const NAME: &str = "RayBudgetView";
        if self.size != view.size() {
            return Err(Error::Mismatch {
                name: NAME,
                found: format!("{:?} pixels", self.size),
                needed: format!("{:?} pixels", view.size()),
            });
        }
        if self.recorded.get(NAME)? == view.recorded.get("BouncedView")?.place {
            return Ok(());
        }
        Err(Error::Recording {
            name: NAME,
            found: "recorded from a Frame of another camera or origin".into(),
        })
    }
}
