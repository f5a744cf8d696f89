//! The viewer in a window: what it does without hands, and what it then shows.
//!
//! `scripts/viewer.sh` gives it a display and a software driver. `DSS_BLESS=1` writes the picture anew that is compared.

use std::{
    path::{Path, PathBuf},
    process::{Command, Output},
};

/// Runs the steps in a window of 640 x 400, of the Cornell box unless they say otherwise.
fn viewer(scene: &str, steps: &str) -> Output {
    Command::new(env!("CARGO_BIN_EXE_deep-screen-space-viewer"))
        .args([scene, "--size", "640x400", "--out"])
        .arg(folder())
        .args(["--script", steps])
        .output()
        .expect("the viewer starts")
}

fn folder() -> PathBuf {
    Path::new(env!("CARGO_TARGET_TMPDIR")).join("viewer")
}

/// What a line of a report says of a name.
fn said<'a>(report: &'a str, name: &str) -> &'a str {
    let (_, rest) = report
        .split_once(&format!("{name}="))
        .unwrap_or_else(|| panic!("no {name} in {report}"));
    if name == "said" {
        return rest;
    }
    rest.split(' ').next().unwrap_or_default()
}

fn number(report: &str, name: &str) -> f64 {
    let text = said(report, name);
    text.parse().unwrap_or_else(|_| panic!("{name} is {text}"))
}

/// The reports of a run that ended well.
fn reports(output: &Output) -> Vec<String> {
    let (out, err) = (
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr),
    );
    assert!(output.status.success(), "{out}\n{err}");
    out.lines()
        .filter_map(|line| line.strip_prefix("report "))
        .map(String::from)
        .collect()
}

/// Starts, moves, resizes, toggles every effect and method, compares with the ray tracer, plans, saves, and writes what it shows.
#[test]
fn does_what_it_is_for() {
    let _ = std::fs::remove_dir_all(folder());
    std::fs::create_dir_all(folder()).unwrap();
    let shot = folder().join("shot.png");
    // Small, since a software driver draws it.
    let steps = [
        "loaded; scale 0.2; frames 2; report",
        "key w 5; drag 40 10; frames 1; report",
        "resize 1x1; frames 2; report; resize 640x400; frames 2; report",
        "mover moves; frames 3; mover rests; frames 1; report",
        "effect a ao splats; frames 1; report",
        "effect a ao depths; frames 1; report",
        "effect a bent rays; frames 1; report",
        "effect a bent splats; frames 1; report",
        "effect a do rays; frames 1; report",
        "effect a do splats; frames 1; report",
        "effect a gi rays; frames 1; report",
        "lamps a off; frames 1; report",
        "join a on; mover moves; frames 2; report; join a off; mover rests",
        "effect a gi splats; frames 1; report",
        "effect a gi depths; frames 1; report",
        "effect a gi hull; frames 1; report",
        "effect a specular rays; frames 1; report",
        "effect a specular splats; frames 1; report",
        "effect a sss splats; frames 1; report",
        "effect a shadow depths; frames 1; report",
        "effect a ao rays; plan error 0.5; frames 1; report",
        "effect a ao rays; compare on; effect b ao depths; show error; frames 1; traced 16; frames 2; report",
        "still; scene no-such-file.glb; loaded; frames 1; report",
    ];
    let last = "show picture; frames 2";
    let steps = format!("{}; {last}; shot {}", steps.join("; "), shot.display());
    let reports = reports(&viewer("cornell", &steps));
    assert_eq!(reports.len(), 24, "{reports:#?}");

    // Each drew something, in passes of its own, and complained of nothing but the last, whose file there is not.
    let (last, others) = reports.split_last().unwrap();
    for report in others {
        assert_eq!(said(report, "said"), "", "{report}");
        assert!(number(report, "stages") >= 2.0, "{report}");
        // Neither black nor without bounds.
        assert!((1e-4..10.0).contains(&number(report, "mean")), "{report}");
    }
    assert_eq!(said(last, "said"), "no-such-file.glb: no such file");
    // It flew, and a window of one pixel became what it was.
    assert_ne!(said(&reports[0], "eye"), said(&reports[1], "eye"));
    assert_eq!(said(&reports[0], "size"), said(&reports[3], "size"));
    assert_eq!(said(&reports[2], "size"), "1x1");
    // The lamp is as bright by rays that are aimed at it as by others, but for noise; and what moves has motion vectors where
    // frames are joined.
    let [aimed, others] = [&reports[11], &reports[12]].map(|report| number(report, "mean"));
    assert!((aimed - others).abs() < 0.2 * aimed, "{aimed} and {others}");
    let [one, joined] = [&reports[12], &reports[13]].map(|report| number(report, "stages"));
    assert_eq!(joined, one + 1.0);
    // The cheapest plan for an error of a half is one that reads the depth buffer.
    assert_eq!(said(&reports[21], "method"), "depths");
    // Rays are nearer to what rays say than depths are: 0.04 and 0.22. By how much depends on how far the truth has come, whose
    // own noise, 0.1 with 16 rays, is taken out.
    let off = said(&reports[22], "rmse");
    let (rays, depths) = off.split_once(',').unwrap();
    let (rays, depths): (f64, f64) = (rays.parse().unwrap(), depths.parse().unwrap());
    assert!(rays > 0.0 && rays < 0.08 && depths > 2.0 * rays, "{off}");
    assert!(number(&reports[22], "rays") >= 16.0);
    // Both sides' pictures were saved, for measuring and for looking.
    for name in [
        "ao-rays-1.png",
        "ao-rays-1.exr",
        "ao-depths-1.png",
        "ao-depths-1.exr",
    ] {
        assert!(folder().join(name).is_file(), "{name}");
    }
    check_picture(&shot);
}

/// The window is as it was when somebody last looked at it.
fn check_picture(shot: &Path) {
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/window.png");
    if std::env::var_os("DSS_BLESS").is_some() {
        std::fs::copy(shot, &golden).unwrap();
    }
    let open = |path: &Path| {
        let image = image::open(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        image.into_rgb8()
    };
    let (found, wanted) = (open(shot), open(&golden));
    assert_eq!(found.dimensions(), wanted.dimensions());
    let differs = |(a, b): &(&u8, &u8)| a.abs_diff(**b) > 24;
    // Drivers round differently, and what a few rays meet is then another thing, at few pixels. A text that is another is more.
    let pairs = found.as_raw().iter().zip(wanted.as_raw());
    let share = pairs.filter(differs).count() as f64 / found.as_raw().len() as f64;
    assert!(
        share < 0.01,
        "{:.1} % of the window is another",
        100.0 * share
    );
    // The picture is neither black nor white, nor is it one colour.
    let left: Vec<u8> = found
        .enumerate_pixels()
        .filter(|(x, ..)| *x < 200)
        .flat_map(|(_, _, p)| p.0)
        .collect();
    let mean = left.iter().map(|v| f64::from(*v)).sum::<f64>() / left.len() as f64;
    let dark = left.iter().filter(|v| f64::from(**v) < mean).count() as f64 / left.len() as f64;
    assert!((5.0..250.0).contains(&mean), "{mean}");
    assert!((0.1..0.95).contains(&dark), "{dark}");
}

/// A line, and no panic, where there is nothing to show.
#[test]
fn says_what_is_wrong() {
    let output = viewer("cornell", "fly");
    let err = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success());
    assert_eq!(err.trim(), "viewer: no step: fly");
}
