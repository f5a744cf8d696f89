//! The example `render` on what is asked of it: the right picture, or one line that says why there is none.

#[allow(dead_code)]
#[path = "../../examples/render/main.rs"]
mod render;

mod files;
mod gltf;
mod places;
mod room;
mod skies;

use std::{path::PathBuf, sync::LazyLock};

use clap::Parser;
use support::gpu::{Ask, Gpu};

static GPU: LazyLock<Gpu> = LazyLock::new(|| Gpu::open(Ask::from_env()).expect("a device"));

/// What a command line came to.
struct Drawn {
    /// The PNG's colour channels, 0 to 1, rows from the top.
    picture: Vec<[f32; 3]>,
    stats: serde_json::Value,
}

impl Drawn {
    fn mean(&self) -> f32 {
        self.picture.iter().map(|p| p[0]).sum::<f32>() / self.picture.len() as f32
    }

    /// Of `--reference`.
    fn off(&self, field: &str) -> f64 {
        self.stats["reference"][field].as_f64().expect(field)
    }
}

/// Root of the mean square difference of two PNGs.
fn rmse(a: &Drawn, b: &Drawn) -> f64 {
    support::errors::rmse(a.picture.as_flattened(), b.picture.as_flattened())
}

/// Runs the example with what stands between spaces; its files go to a folder of that name.
fn render(name: &str, arguments: &str) -> Result<Drawn, String> {
    let folder = folder(name);
    let words = arguments.split_whitespace().map(str::to_owned);
    let words = [
        "render".into(),
        "--out".into(),
        folder.display().to_string(),
    ]
    .into_iter()
    .chain(words);
    let options = render::Options::try_parse_from(words).map_err(|e| e.to_string())?;
    let (scene, shot) = render::prepare(&options)?;
    render::draw(&GPU, &options, &scene, &shot)?;
    let effect = &options.effect;
    let png = image::open(folder.join(format!("{effect}.png"))).expect("a picture");
    let text = std::fs::read_to_string(folder.join("stats.json")).expect("statistics");
    Ok(Drawn {
        picture: png.to_rgb32f().pixels().map(|p| p.0).collect(),
        stats: serde_json::from_str(&text).expect("JSON"),
    })
}

/// A folder that is the running test's alone, and is gone with its thread: tests run side by side, in one process and in
/// several, and some use the same names.
fn folder(name: &str) -> PathBuf {
    struct Own(PathBuf);
    impl Drop for Own {
        fn drop(&mut self) {
            // Nothing is there where the test wrote nothing.
            let _ = std::fs::remove_dir_all(&self.0);
        }
    }
    thread_local! {
        static OWN: Own = {
            let thread = std::thread::current();
            let test = thread.name().expect("a test's thread").replace("::", "-");
            let name = format!("render-{}-{test}", std::process::id());
            Own(PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name))
        };
    }
    let folder = OWN.with(|own| own.0.join(name));
    std::fs::create_dir_all(&folder).expect("a folder");
    folder
}
