//! `public_api FILE.json`: prints what rustdoc's JSON says is public, an item a line.
//!
//! The library of `cargo-public-api` without the rest of that program, which takes five times as long to build.

use std::{env, process::ExitCode};

use public_api::Builder;

/// What the compiler says of every type, and is worth a line only where it says no.
const ASSUMED: [&str; 3] = [
    "core::marker::Send",
    "core::marker::Sync",
    "core::marker::Unpin",
];
/// What it says besides, which is nobody's promise.
const UNASKED: [&str; 5] = [
    "core::marker::Freeze",
    "core::marker::StructuralPartialEq",
    "core::marker::UnsafeUnpin",
    "core::panic::unwind_safe::RefUnwindSafe",
    "core::panic::unwind_safe::UnwindSafe",
];

fn is_listed(line: &str) -> bool {
    let has = |name: &&str, before: &str| line.contains(&format!("{before}{name} for "));
    !(line.starts_with("impl")
        && (ASSUMED.iter().any(|name| has(name, " "))
            || UNASKED.iter().any(|name| has(name, " ") || has(name, "!"))))
}

fn main() -> ExitCode {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let [file] = arguments.as_slice() else {
        eprintln!("usage: public_api FILE.json");
        return ExitCode::from(2);
    };
    let api = Builder::from_rustdoc_json(file)
        .omit_blanket_impls(true)
        .sorted(true)
        .build();
    match api {
        Ok(api) => {
            let lines = api.items().map(ToString::to_string);
            for line in lines.filter(|line| is_listed(line)) {
                println!("{line}");
            }
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("public_api: {error}");
            ExitCode::FAILURE
        }
    }
}
