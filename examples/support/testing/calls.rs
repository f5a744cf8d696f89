//! What was asked of a device, counted by what wgpu logs of it.

use std::{cell::RefCell, collections::BTreeMap, sync::Once};

use log::{LevelFilter, Log, Metadata, Record};

/// What one thread asked for.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Calls {
    /// Passes in their order: the label of each and how many dispatches and draws it has.
    pub passes: Vec<(String, u32)>,
    /// Objects that were made, by wgpu's names of the functions.
    pub made: BTreeMap<String, u32>,
    /// Textures and buffers cleared, or copied to.
    pub transfers: u32,
}

thread_local! {
    static CALLS: RefCell<Option<Calls>> = const { RefCell::new(None) };
}

/// What a call of `record` asks for. Passes are counted when their encoder is finished.
pub fn of<R>(record: impl FnOnce() -> R) -> (Calls, R) {
    static LOGGER: Once = Once::new();
    LOGGER.call_once(|| {
        log::set_logger(&Counter).expect("no other logger");
        log::set_max_level(LevelFilter::Trace);
    });
    CALLS.set(Some(Calls::default()));
    let result = record();
    (CALLS.take().unwrap_or_default(), result)
}

/// A logger that counts for those threads that ask.
struct Counter;

impl Log for Counter {
    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        metadata.target().starts_with("wgpu_core") && CALLS.with_borrow(Option::is_some)
    }

    fn log(&self, record: &Record<'_>) {
        if self.enabled(record.metadata()) {
            let message = record.args().to_string();
            CALLS.with_borrow_mut(|calls| calls.as_mut().map(|calls| calls.count(&message)));
        }
    }

    fn flush(&self) {}
}

impl Calls {
    fn count(&mut self, message: &str) {
        if let Some(begun) = message.strip_prefix("Begin encoding ") {
            let label = begun.split('\'').nth(1).unwrap_or_default();
            self.passes.push((label.to_owned(), 0));
        } else if ["ComputePass::dispatch", "RenderPass::draw"]
            .iter()
            .any(|call| message.starts_with(call))
        {
            if let Some((_, count)) = self.passes.last_mut() {
                *count += 1;
            }
        } else if let Some(made) = message.strip_prefix("Device::create_") {
            let name: String = made
                .chars()
                .take_while(|c| c.is_alphabetic() || *c == '_')
                .collect();
            *self.made.entry(name).or_default() += 1;
        } else if ["CommandEncoder::clear", "CommandEncoder::copy"]
            .iter()
            .any(|call| message.starts_with(call))
        {
            self.transfers += 1;
        }
    }
}
