//! `bindgen MODULE.wasm FOLDER`: writes the module and its JavaScript, for pages that load them as a module, into a folder.
//!
//! The library of `wasm-bindgen-cli` without the rest of that program, which takes several times as long to build.

use std::{env, process::ExitCode};

fn main() -> ExitCode {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let [module, folder] = arguments.as_slice() else {
        eprintln!("usage: bindgen MODULE.wasm FOLDER");
        return ExitCode::from(2);
    };
    let mut bindgen = wasm_bindgen_cli_support::Bindgen::new();
    let written = bindgen
        .input_path(module)
        .typescript(false)
        // The page finds the module beside its JavaScript.
        .omit_default_module_path(false)
        // Neither is read in a browser.
        .remove_name_section(true)
        .remove_producers_section(true)
        .web(true)
        .and_then(|bindgen| bindgen.generate(folder));
    match written {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("bindgen: {error:#}");
            ExitCode::FAILURE
        }
    }
}
