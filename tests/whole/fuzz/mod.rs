//! Seeded random cases over all passes: settings and what lies beyond their ranges, cameras, viewports, meshes, formats,
//! contents of buffers and textures, capacities down to 0, images from 1 × 1 pixels. Every call gives a result or a typed
//! error, and with nothing out of range a result. No validation error, panic, hang, or number that is none in what comes out;
//! and each case runs twice and gives the same bits.
//!
//! `DSS_FUZZ_CASES` is how many cases each test runs, `DSS_FUZZ_SEED` the first case's seed; the next cases have the next
//! seeds. A case that fails prints its seed and its inputs, and runs alone with
//! `DSS_FUZZ_SEED=… DSS_FUZZ_CASES=1 cargo test --test whole fuzz::NAME`.

mod case;
mod hull;
mod inputs;
mod instances;
mod random;
mod rays;
mod screen;
mod splats;
mod surfels;
mod temporal;

use std::{
    cell::RefCell,
    panic::{AssertUnwindSafe, catch_unwind},
    sync::{
        Arc, Mutex,
        atomic::{AtomicU64, Ordering},
    },
    time::{Duration, Instant},
};

use case::{Case, Outcome, World};
use deep_screen_space::wgpu;
use support::gpu::{Ask, Gpu};

/// Far more than any case takes, with the compilation of what it is the first to use; a hang is longer.
const PATIENCE: Duration = Duration::from_secs(300);

/// How many cases a device is used for. Pipelines on lavapipe of Mesa 22.3 grow with use, by megabytes a case
/// (`tests/soak.rs`).
const RENEWED: u64 = 256;

/// How many failures are printed; the cases after them are left out.
const MOST_FAILURES: usize = 20;

fn from_env(name: &str, default: u64) -> u64 {
    std::env::var(name).map_or(default, |value| {
        let parsed = value
            .strip_prefix("0x")
            .map_or_else(|| value.parse(), |hex| u64::from_str_radix(hex, 16));
        parsed.unwrap_or_else(|e| panic!("{name} is {value}: {e}"))
    })
}

/// Ends the program where a case hangs: no other thread could.
fn watch(name: &'static str) -> Arc<AtomicU64> {
    let current = Arc::new(AtomicU64::new(0));
    let watched = Arc::downgrade(&current);
    std::thread::spawn(move || {
        let (mut last, mut since) = (0, Instant::now());
        while let Some(current) = watched.upgrade() {
            let now = current.load(Ordering::Relaxed);
            drop(current);
            if now != last {
                (last, since) = (now, Instant::now());
            } else if since.elapsed() > PATIENCE {
                eprintln!("{name}: the case after {last} others hangs");
                std::process::abort();
            }
            std::thread::sleep(Duration::from_millis(200));
        }
    });
    current
}

/// A device whose errors are kept.
fn open() -> (World, Arc<Mutex<Vec<String>>>) {
    // Without a word in the environment about what to ask for.
    let ask = std::env::var_os("DSS_LIMITS").map_or(Ask::Useful, |_| Ask::from_env());
    let gpu = Gpu::open(ask).expect("a graphics adapter; scripts/test.sh installs one");
    let errors = Arc::new(Mutex::new(Vec::new()));
    let kept = errors.clone();
    gpu.device
        .on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            kept.lock().expect("no panic").push(error.to_string());
        }));
    (World::new(gpu), errors)
}

/// What is wrong with a case, if anything.
fn try_case(
    world: &World,
    seed: u64,
    errors: &Mutex<Vec<String>>,
    notes: &RefCell<Vec<String>>,
    record: fn(&mut Case<'_>),
) -> Result<Outcome, String> {
    let run = || {
        let mut case = Case::new(world, seed, notes);
        record(&mut case);
        let is_wild = case.random.is_wild();
        (case.finish(), is_wild)
    };
    let outcomes = catch_unwind(AssertUnwindSafe(|| [run(), run()]));
    let errors = std::mem::take(&mut *errors.lock().expect("no panic"));
    if !errors.is_empty() {
        return Err(errors.join("\n"));
    }
    let [(first, is_wild), (second, _)] = outcomes.map_err(|panic| {
        let text = panic
            .downcast_ref::<String>()
            .map(String::as_str)
            .or(panic.downcast_ref::<&str>().copied());
        format!("panicked: {}", text.unwrap_or("?"))
    })?;
    if !first.wrong.is_empty() {
        return Err(first.wrong.join("\n"));
    }
    if !is_wild && !first.refused.is_empty() {
        return Err(format!(
            "refused with nothing out of range: {:?}",
            first.refused
        ));
    }
    for ((name, a), (_, b)) in first.results.iter().zip(&second.results) {
        if let Some(i) = (0..a.len().max(b.len())).find(|&i| a.get(i) != b.get(i)) {
            let word = |bytes: &[u8]| bytes.chunks(4).nth(i / 4).map(<[u8]>::to_vec);
            return Err(format!(
                "{name} differs from run to run, in word {}: {:02x?}, {:02x?}",
                i / 4,
                word(a),
                word(b)
            ));
        }
    }
    if first != second {
        return Err(format!(
            "differs from run to run: {:?}, {:?}",
            first.refused, second.refused
        ));
    }
    Ok(first)
}

/// The first so many cases, and before them those of `known`, where the environment names no others.
fn fuzz(name: &'static str, known: &[u64], cases: u64, record: fn(&mut Case<'_>)) {
    let (mut world, mut errors) = open();
    let count = from_env("DSS_FUZZ_CASES", cases);
    let first = from_env("DSS_FUZZ_SEED", 1);
    let named = ["DSS_FUZZ_CASES", "DSS_FUZZ_SEED"].map(std::env::var_os);
    let known = if named == [None, None] { known } else { &[] };
    let seeds = known.iter().copied().chain(first..first + count);
    let cases = known.len() as u64 + count;
    let progress = watch(name);
    let notes = RefCell::default();
    let (mut refused, mut failed, mut times) = (0, Vec::new(), Vec::new());
    let start = Instant::now();
    for (number, seed) in (0..cases).zip(seeds) {
        if number > 0 && number.is_multiple_of(RENEWED) {
            (world, errors) = open();
        }
        let began = Instant::now();
        match try_case(&world, seed, &errors, &notes, record) {
            Ok(outcome) => refused += u64::from(!outcome.refused.is_empty()),
            Err(problem) => {
                eprintln!(
                    "{name}, DSS_FUZZ_SEED={seed}: {problem}\n  {}",
                    notes.borrow().join("\n  ")
                );
                failed.push(seed);
                if failed.len() == MOST_FAILURES {
                    break;
                }
            }
        }
        times.push((began.elapsed(), seed));
        progress.fetch_add(1, Ordering::Relaxed);
    }
    let seconds = start.elapsed().as_secs_f64();
    println!(
        "{name} on {}: {cases} cases in {seconds:.1} s, {:.1} a second, {refused} refused, {} pipelines made",
        world.gpu.name(),
        cases as f64 / seconds,
        world.made()
    );
    times.sort_unstable();
    let median = times.get(times.len() / 2);
    let slowest: Vec<_> = times.iter().rev().take(5).collect();
    println!("  median (time, seed) {median:?}, slowest {slowest:?}");
    assert!(failed.is_empty(), "{name}: failed with seeds {failed:?}");
}

#[test]
fn surfels_splatted() {
    fuzz("surfels_splatted", &[], 10, splats::record);
}

#[test]
fn surfels_traced() {
    fuzz("surfels_traced", &[], 10, rays::record);
}

#[test]
fn instances_traced() {
    fuzz("instances_traced", &[], 10, instances::record);
}

#[test]
fn images_in_parts() {
    fuzz("images_in_parts", &[], 10, screen::record);
}

#[test]
fn hulls() {
    // They were wrong once: a mean irradiance that followed the order of vertices, and garbage that gave NaN with gloss.
    fuzz("hulls", &[260, 367], 10, hull::record);
}

#[test]
fn frames() {
    fuzz("frames", &[], 10, temporal::record);
}
