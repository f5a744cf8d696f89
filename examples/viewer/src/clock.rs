//! How long each pass takes.

use std::sync::{Arc, Mutex, PoisonError};

use deep_screen_space::wgpu;
use support::{gpu::Gpu, stages::Stages};

/// A stage of a side, and the milliseconds that it took at last.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    pub side: &'static str,
    pub name: &'static str,
    pub ms: f64,
}

/// The times of the last frame that was recorded and whose times are known.
#[derive(Default)]
pub struct Clock {
    stamps: Option<Stamps>,
    rows: Vec<Row>,
}

/// Stages of a frame that there are timestamps for.
const MOST: u32 = 64;

/// Timestamps of one frame, on their way or not.
struct Stamps {
    set: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    read: wgpu::Buffer,
    /// What they are of, while they are on their way.
    waiting: Option<Vec<Row>>,
    arrived: Arc<Mutex<bool>>,
}

impl Clock {
    /// By timestamps, where the device has them and is no software. Otherwise each stage is a submission that is waited for, and
    /// its time that of the queue, or of the processor that does its work.
    pub fn new(gpu: &Gpu) -> Self {
        let by_stamps = gpu
            .device
            .features()
            .contains(wgpu::Features::TIMESTAMP_QUERY)
            && !gpu.on_processor();
        Self {
            stamps: by_stamps.then(|| Stamps::new(gpu)),
            rows: Vec::new(),
        }
    }

    /// What is known, in the order in which it was recorded.
    pub fn rows(&self) -> &[Row] {
        &self.rows
    }

    pub fn total_ms(&self) -> f64 {
        self.rows.iter().map(|row| row.ms).sum()
    }

    /// Begins a frame.
    pub fn begin<'a>(&'a mut self, gpu: &'a Gpu) -> Recording<'a> {
        if let Some(stamps) = &mut self.stamps
            && let Some(rows) = stamps.take(gpu)
        {
            self.rows = rows;
        }
        let stamped = self.stamps.as_ref().is_some_and(|s| s.waiting.is_none());
        Recording {
            encoder: self.stamps.is_some().then(|| gpu.encoder()),
            gpu,
            clock: self,
            side: "",
            rows: Vec::new(),
            stamped,
        }
    }
}

/// A frame that is being recorded.
pub struct Recording<'a> {
    gpu: &'a Gpu,
    clock: &'a mut Clock,
    /// Of the stages that come.
    pub side: &'static str,
    /// Where all stages go that are not waited for.
    encoder: Option<wgpu::CommandEncoder>,
    rows: Vec<Row>,
    /// Whether this frame's times are taken: not while others are on their way.
    stamped: bool,
}

impl Recording<'_> {
    /// Submits what was not yet.
    pub fn end(mut self) {
        let Some(mut encoder) = self.encoder.take() else {
            self.clock.rows = std::mem::take(&mut self.rows);
            return;
        };
        if let Some(stamps) = &mut self.clock.stamps
            && self.stamped
            && !self.rows.is_empty()
        {
            stamps.mark(&mut encoder, self.rows.len() as u32);
            stamps.resolve(&mut encoder, std::mem::take(&mut self.rows));
        }
        self.gpu.queue.submit([encoder.finish()]);
    }
}

impl Stages for Recording<'_> {
    fn stage<R>(
        &mut self,
        name: &'static str,
        record: impl FnOnce(&mut wgpu::CommandEncoder) -> R,
    ) -> R {
        let side = self.side;
        let Some(encoder) = &mut self.encoder else {
            let (ms, result) = self.gpu.time(record);
            self.rows.push(Row { side, name, ms });
            return result;
        };
        let number = self.rows.len() as u32;
        if let Some(stamps) = &self.clock.stamps
            && self.stamped
            && number + 1 < MOST
        {
            stamps.mark(encoder, number);
            let ms = 0.0;
            self.rows.push(Row { side, name, ms });
        }
        record(encoder)
    }
}

impl Stamps {
    fn new(gpu: &Gpu) -> Self {
        let buffer = |usage| {
            gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("times"),
                size: 8 * u64::from(MOST),
                usage,
                mapped_at_creation: false,
            })
        };
        Self {
            set: gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("times"),
                ty: wgpu::QueryType::Timestamp,
                count: MOST,
            }),
            resolved: buffer(wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC),
            read: buffer(wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST),
            waiting: None,
            arrived: Arc::default(),
        }
    }

    /// The time that it is when what was recorded so far is done: an empty pass's.
    fn mark(&self, encoder: &mut wgpu::CommandEncoder, number: u32) {
        encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: None,
            timestamp_writes: Some(wgpu::ComputePassTimestampWrites {
                query_set: &self.set,
                beginning_of_pass_write_index: Some(number),
                end_of_pass_write_index: None,
            }),
        });
    }

    fn resolve(&mut self, encoder: &mut wgpu::CommandEncoder, rows: Vec<Row>) {
        let marks = rows.len() as u32 + 1;
        encoder.resolve_query_set(&self.set, 0..marks, &self.resolved, 0);
        encoder.copy_buffer_to_buffer(&self.resolved, 0, &self.read, 0, None);
        self.waiting = Some(rows);
        let arrived = Arc::clone(&self.arrived);
        encoder.map_buffer_on_submit(&self.read, wgpu::MapMode::Read, .., move |mapped| {
            *arrived.lock().unwrap_or_else(PoisonError::into_inner) = mapped.is_ok();
        });
    }

    /// The times, once they are there.
    fn take(&mut self, gpu: &Gpu) -> Option<Vec<Row>> {
        let mut arrived = self.arrived.lock().unwrap_or_else(PoisonError::into_inner);
        if !std::mem::take(&mut *arrived) {
            return None;
        }
        let mut rows = self.waiting.take()?;
        {
            let bytes = self.read.get_mapped_range(..).ok()?;
            let marks: Vec<u64> = bytemuck::pod_collect_to_vec(&bytes);
            let milliseconds = f64::from(gpu.queue.get_timestamp_period()) * 1e-6;
            for (row, ends) in rows.iter_mut().zip(marks.windows(2)) {
                row.ms = ends[1].saturating_sub(ends[0]) as f64 * milliseconds;
            }
        }
        self.read.unmap();
        Some(rows)
    }
}

#[cfg(test)]
mod tests {
    use support::gpu::Ask;

    use super::*;

    /// Frames whose stages say what they are, by waiting and, where the device can, by timestamps.
    #[test]
    fn stages_are_named_and_timed() {
        let gpu = Gpu::open(Ask::Useful).unwrap();
        let can = gpu
            .device
            .features()
            .contains(wgpu::Features::TIMESTAMP_QUERY);
        for stamps in [false, true] {
            let mut clock = Clock {
                stamps: (stamps && can).then(|| Stamps::new(&gpu)),
                rows: Vec::new(),
            };
            let buffer = gpu.buffer(&[0_u32; 64], wgpu::BufferUsages::COPY_DST);
            // Times of one frame are known in a later one.
            for _ in 0..3 {
                let mut frame = clock.begin(&gpu);
                frame.stage("one", |encoder| encoder.clear_buffer(&buffer, 0, None));
                frame.side = "A";
                frame.stage("two", |encoder| encoder.clear_buffer(&buffer, 0, None));
                frame.end();
                gpu.finish(gpu.encoder());
            }
            let names: Vec<_> = clock
                .rows()
                .iter()
                .map(|row| (row.side, row.name))
                .collect();
            assert_eq!(names, [("", "one"), ("A", "two")]);
            assert!(clock.rows().iter().all(|row| row.ms >= 0.0 && row.ms < 1e4));
        }
    }
}
