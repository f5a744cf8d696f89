//! Counts that come back from the GPU a frame or two later, without anybody waiting for them.

use std::sync::{Arc, Mutex, PoisonError};

use wgpu::{Buffer, BufferUsages, CommandEncoder, Device, MapMode};

use crate::surfel::SurfelCounts;

/// A buffer on its way to the CPU, or none.
#[derive(Debug, Default)]
pub(crate) struct Readback {
    buffer: Option<Buffer>,
    state: Arc<Mutex<State>>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum State {
    #[default]
    Idle,
    /// Copied by a recording.
    Recorded,
    Mapped,
    /// The mapping failed: the buffer is of no more use.
    Lost,
}

/// Tells what became of a recording: also if its encoder is dropped without being submitted.
struct Ticket(Arc<Mutex<State>>);

impl Ticket {
    fn set(&self, state: State) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = state;
    }
}

impl Drop for Ticket {
    fn drop(&mut self) {
        let mut state = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if *state == State::Recorded {
            *state = State::Idle;
        }
    }
}

impl Readback {
    fn state(&self) -> State {
        *self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What arrived since the last call, if anything did.
    pub fn take(&mut self) -> Option<SurfelCounts> {
        match self.state() {
            State::Idle | State::Recorded => return None,
            State::Lost => {
                *self = Self::default();
                return None;
            }
            State::Mapped => {}
        }
        let buffer = self.buffer.as_ref()?;
        let counts = buffer
            .get_mapped_range(..)
            .ok()
            .map(|bytes| bytemuck::pod_read_unaligned(&bytes));
        buffer.unmap();
        *self.state.lock().unwrap_or_else(PoisonError::into_inner) = State::Idle;
        counts
    }

    /// Has the counts copied, unless earlier ones are still on their way.
    pub fn record(&mut self, device: &Device, encoder: &mut CommandEncoder, counters: &Buffer) {
        if self.state() != State::Idle {
            return;
        }
        let buffer = self.buffer.get_or_insert_with(|| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("deep-screen-space counts"),
                size: size_of::<SurfelCounts>() as u64,
                usage: BufferUsages::MAP_READ | BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        });
        encoder.copy_buffer_to_buffer(counters, 0, buffer, 0, buffer.size());
        let ticket = Ticket(Arc::clone(&self.state));
        ticket.set(State::Recorded);
        encoder.map_buffer_on_submit(buffer, MapMode::Read, .., move |mapped| {
            ticket.set(if mapped.is_ok() {
                State::Mapped
            } else {
                State::Lost
            });
        });
    }
}
