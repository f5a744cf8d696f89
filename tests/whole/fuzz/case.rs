//! One case: what it was given, what it was refused, and what it left on the GPU.

use std::{any::Any, cell::RefCell, collections::HashMap, fmt::Debug, rc::Rc};

use deep_screen_space::{
    Error, Timestamps,
    wgpu::{self, Buffer, CommandEncoder, Device, Texture, TextureFormat as Format},
};

use super::random::Random;
use support::gpu::Gpu;

/// A device, and pipelines that are made once for all cases that ask for the same.
pub struct World {
    pub gpu: Gpu,
    made: RefCell<HashMap<String, Rc<dyn Any>>>,
    staging: Buffer,
    queries: Option<wgpu::QuerySet>,
}

/// Of the buffer that all results of a case fit into.
const STAGING: u64 = 1 << 25;
const QUERIES: u32 = 16;

impl World {
    pub fn new(gpu: Gpu) -> Self {
        let staging = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: STAGING,
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let has_queries = gpu
            .device
            .features()
            .contains(wgpu::Features::TIMESTAMP_QUERY);
        let queries = has_queries.then(|| {
            gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
                label: None,
                ty: wgpu::QueryType::Timestamp,
                count: QUERIES,
            })
        });
        Self {
            gpu,
            made: RefCell::default(),
            staging,
            queries,
        }
    }

    /// What `make` made for this key before, or makes now.
    pub fn once<T: 'static>(
        &self,
        key: impl Debug,
        make: impl FnOnce(&Device) -> Result<T, Error>,
    ) -> Result<Rc<T>, Error> {
        let key = format!("{} {key:?}", std::any::type_name::<T>());
        if let Some(known) = self.made.borrow().get(&key) {
            return Ok(known.clone().downcast().expect("the key names the type"));
        }
        let new = Rc::new(make(&self.gpu.device)?);
        self.made.borrow_mut().insert(key, new.clone());
        Ok(new)
    }

    /// How many things were made.
    pub fn made(&self) -> usize {
        self.made.borrow().len()
    }
}

/// What the bytes of a result are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// `f32`s, all of which have to be finite.
    Floats,
    /// `f16`s, likewise.
    Halves,
    /// Anything.
    Bits,
}

enum Source {
    Buffer(Buffer),
    Texture(Texture),
}

struct Output {
    name: &'static str,
    kind: Kind,
    source: Source,
}

/// What a case left.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct Outcome {
    /// What was refused.
    pub refused: Vec<String>,
    /// A name and bytes.
    pub results: Vec<(&'static str, Vec<u8>)>,
    /// What is wrong with the results.
    pub wrong: Vec<String>,
}

/// How many successive cases have the same pipelines and formats.
const FAMILY: u64 = 32;

/// One case while it is recorded.
pub struct Case<'w> {
    pub world: &'w World,
    family: u64,
    pub random: Random,
    pub encoder: CommandEncoder,
    notes: &'w RefCell<Vec<String>>,
    refused: Vec<String>,
    outputs: Vec<Output>,
    any_order: bool,
}

impl<'w> Case<'w> {
    pub fn new(world: &'w World, seed: u64, notes: &'w RefCell<Vec<String>>) -> Self {
        notes.borrow_mut().clear();
        Self {
            world,
            family: seed / FAMILY,
            random: Random::new(seed),
            encoder: world.gpu.encoder(),
            notes,
            refused: Vec::new(),
            outputs: Vec::new(),
            any_order: false,
        }
    }

    pub fn device(&self) -> &'w Device {
        &self.world.gpu.device
    }

    /// A choice that is the same in some successive cases, of what drivers compile pipelines anew for: formats above all, which
    /// lavapipe and `SwiftShader` compile into the code that reads them. Otherwise that would take most of the time.
    pub fn usual<T: Clone>(&self, name: &str, choices: &[T]) -> T {
        let name = name.bytes().fold(self.family, |hash, byte| {
            (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
        });
        Random::new(name).one_of(choices)
    }

    /// A number of times that a shader loops, which lavapipe of Mesa 22.3 compiles into it.
    pub fn loops(&mut self, name: &str, high: u32) -> u32 {
        if self.random.breaks() {
            return self.random.count(1, high);
        }
        self.usual(name, &[1, 2, 7, 16, 33, 100, high])
    }

    /// Keeps an input, to be printed if the case fails.
    pub fn note(&self, name: &str, value: impl Debug) {
        self.notes.borrow_mut().push(format!("{name}: {value:?}"));
    }

    /// What a call gave, or `None` where it refused.
    pub fn accept<T>(&mut self, result: Result<T, Error>) -> Option<T> {
        match result {
            Ok(value) => Some(value),
            Err(error) => {
                self.note("refused", &error);
                self.refused.push(error.to_string());
                None
            }
        }
    }

    pub fn once<T: 'static>(
        &mut self,
        key: impl Debug,
        make: impl FnOnce(&Device) -> Result<T, Error>,
    ) -> Option<Rc<T>> {
        let made = self.world.once(key, make);
        self.accept(made)
    }

    /// Where to write times, if the device can.
    pub fn timestamps(&mut self) -> Option<Timestamps<'w>> {
        let set = self.world.queries.as_ref()?;
        if self.random.chance(0.8) {
            return None;
        }
        // Another pair each time: wgpu refuses to write one twice in an encoder's pass.
        let begin = self.random.below(QUERIES / 2) * 2;
        let mut stamps = Timestamps {
            set,
            begin,
            end: begin + 1,
        };
        if self.random.breaks() {
            stamps.end = self.random.one_of(&[begin, QUERIES, u32::MAX]);
        }
        self.note("timestamps", (stamps.begin, stamps.end));
        Some(stamps)
    }

    /// Says that results may differ from run to run.
    pub fn any_order(&mut self) {
        self.any_order = true;
    }

    /// A buffer to be read back.
    pub fn buffer(&mut self, name: &'static str, buffer: &Buffer, kind: Kind) {
        self.outputs.push(Output {
            name,
            kind,
            source: Source::Buffer(buffer.clone()),
        });
    }

    /// A texture to be read back, all its layers.
    pub fn texture(&mut self, name: &'static str, texture: &Texture) {
        let kind = match texture.format() {
            Format::R32Float | Format::Rg32Float | Format::Rgba32Float => Kind::Floats,
            Format::R16Float | Format::Rg16Float | Format::Rgba16Float => Kind::Halves,
            _ => Kind::Bits,
        };
        self.outputs.push(Output {
            name,
            kind,
            source: Source::Texture(texture.clone()),
        });
    }

    /// Submits, waits, and reads all results at once.
    pub fn finish(mut self) -> Outcome {
        let mut places = Vec::new();
        let mut end = 0;
        for output in &self.outputs {
            let place = match &output.source {
                Source::Buffer(buffer) => {
                    let bytes = buffer.size();
                    if end + bytes > STAGING {
                        continue;
                    }
                    let staging = &self.world.staging;
                    self.encoder
                        .copy_buffer_to_buffer(buffer, 0, staging, end, Some(bytes));
                    Place {
                        start: end as usize,
                        rows: 1,
                        row: bytes as usize,
                        pitch: bytes as usize,
                    }
                }
                Source::Texture(texture) => {
                    let place = Place::of(texture, end as usize);
                    if end + place.bytes() > STAGING {
                        continue;
                    }
                    copy_texture(&mut self.encoder, texture, &self.world.staging, &place);
                    place
                }
            };
            end = (end + place.bytes()).next_multiple_of(256);
            places.push((output.name, output.kind, place));
        }
        let gpu = &self.world.gpu;
        gpu.queue.submit([self.encoder.finish()]);
        let mut outcome = Outcome {
            refused: self.refused,
            ..Outcome::default()
        };
        let staging = &self.world.staging;
        if end > 0 {
            staging.map_async(wgpu::MapMode::Read, ..end, |_| {});
        }
        gpu.device
            .poll(wgpu::PollType::wait_indefinitely())
            .expect("the device answers");
        if end > 0 {
            {
                let bytes = staging
                    .get_mapped_range(..end)
                    .expect("the buffer is mapped");
                for (name, kind, place) in places {
                    let result = place.read(&bytes);
                    outcome.wrong.extend(wrong(name, kind, &result));
                    if !self.any_order {
                        outcome.results.push((name, result));
                    }
                }
            }
            staging.unmap();
        }
        outcome
    }
}

/// Where a result lies in the staging buffer.
struct Place {
    start: usize,
    rows: usize,
    row: usize,
    pitch: usize,
}

impl Place {
    fn of(texture: &Texture, start: usize) -> Self {
        let texel = texture.format().block_copy_size(None).expect("a colour") as usize;
        let row = texel * texture.width() as usize;
        Self {
            start,
            rows: (texture.height() * texture.depth_or_array_layers()) as usize,
            row,
            pitch: row.next_multiple_of(256),
        }
    }

    fn bytes(&self) -> u64 {
        (self.rows * self.pitch) as u64
    }

    fn read(&self, staging: &[u8]) -> Vec<u8> {
        (0..self.rows)
            .flat_map(|row| &staging[self.start + row * self.pitch..][..self.row])
            .copied()
            .collect()
    }
}

fn copy_texture(encoder: &mut CommandEncoder, texture: &Texture, staging: &Buffer, place: &Place) {
    encoder.copy_texture_to_buffer(
        texture.as_image_copy(),
        wgpu::TexelCopyBufferInfo {
            buffer: staging,
            layout: wgpu::TexelCopyBufferLayout {
                offset: place.start as u64,
                bytes_per_row: Some(place.pitch as u32),
                rows_per_image: Some(texture.height()),
            },
        },
        texture.size(),
    );
}

/// The first number that is none, and how many there are.
fn wrong(name: &str, kind: Kind, bytes: &[u8]) -> Option<String> {
    let (size, is_number): (usize, fn(&[u8]) -> bool) = match kind {
        Kind::Bits => return None,
        Kind::Floats => (4, |b| {
            f32::from_le_bytes(b.try_into().expect("4 bytes")).is_finite()
        }),
        Kind::Halves => (2, |b| b[1] & 0x7c != 0x7c),
    };
    let odd: Vec<usize> = (0..)
        .zip(bytes.chunks_exact(size))
        .filter(|(_, number)| !is_number(number))
        .map(|(i, _)| i)
        .collect();
    let first = odd.first()?;
    let found = &bytes[first * size..][..size];
    Some(format!(
        "{name}: {} of {} numbers are not finite, the first at {first}, {found:02x?}",
        odd.len(),
        bytes.len() / size
    ))
}
