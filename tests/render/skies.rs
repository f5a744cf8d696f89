//! `--sky FILE`.

use deep_screen_space::glam::DVec3;
use support::{files, sky};

use super::{folder, render, rmse};

const VIEW: &str = "cornell --effect do --size 48x32";

/// Writes a picture of latitude and longitude, and names the file.
fn file(name: &str, size: [u32; 2], texels: &[[f32; 3]]) -> String {
    let path = folder("skies").join(name);
    let [width, height] = size;
    match name.rsplit_once('.') {
        Some((_, "exr")) => files::write_exr_rgb(&path, width, height, texels).expect("an EXR"),
        Some((_, "png")) => {
            files::write_png_rgb(&path, width, height, texels, 1.0).expect("a PNG");
        }
        _ => image::Rgb32FImage::from_raw(width, height, texels.concat())
            .expect("texels")
            .save(&path)
            .expect("an HDR"),
    }
    path.display().to_string()
}

/// A sky that the example makes gives the same picture from a file.
#[test]
fn a_file_is_what_it_was_written_from() {
    let made = sky::by_name("dim").expect("a sky");
    let texels: Vec<[f32; 3]> = made.texels.iter().map(|t| t.as_vec3().into()).collect();
    let file = file("dim.exr", made.size.map(|n| n as u32), &texels);
    let of_name = render("name", &format!("{VIEW} --sky dim")).expect("a picture");
    let of_file = render("file", &format!("{VIEW} --sky {file}")).expect("a picture");
    assert!(of_name.mean() > 0.05, "{}", of_name.mean());
    assert_eq!(rmse(&of_name, &of_file), 0.0);
}

/// Rows from the top, whichever the format; sRGB is decoded where a format holds it.
#[test]
fn formats_agree() {
    // HDR has eight bits of a mantissa that all channels share, and PNG eight bits of sRGB.
    for (name, within) in [("two.exr", 1e-6), ("two.hdr", 0.01), ("two.png", 0.01)] {
        let mut texels = vec![[0.75, 0.5, 0.25]; 8];
        texels.extend([[0.125; 3]; 8]);
        let file = file(name, [4, 4], &texels);
        let read = sky::open(&file, 8).expect(name);
        assert_eq!(read.size, [4, 4]);
        for (texel, expected) in read.texels.iter().zip(&texels) {
            let off = (*texel - DVec3::from_array(expected.map(f64::from))).abs();
            assert!(off.max_element() < within, "{name}: {texel}");
        }
    }
}

#[test]
fn what_cannot_be_read_is_one_line() {
    let text = folder("skies").join("text.png");
    std::fs::write(&text, "no picture").expect("a file");
    for (sky, why) in [
        ("missing.exr", "missing.exr"),
        ("missing.hdr", "missing.hdr"),
        ("sunnny", "sunnny is neither sunny nor dim"),
        (text.to_str().expect("a path"), "text.png"),
    ] {
        let problem = render("refused", &format!("{VIEW} --sky {sky}"))
            .err()
            .expect(why);
        assert!(
            problem.contains(why) && !problem.contains('\n'),
            "{problem}"
        );
    }
}

/// Nothing is decoded of pictures without texels, or with more than fit.
#[test]
fn sizes_that_cannot_be_are_refused() {
    for name in ["wide.exr", "wide.hdr", "wide.png"] {
        let file = file(name, [16, 2], &[[1.0; 3]; 32]);
        let problem = sky::open(&file, 8).expect_err("too many columns");
        assert!(problem.contains("16x2 texels"), "{problem}");
        sky::open(&file, 16).expect(name);
    }
    let empty = folder("skies").join("empty.hdr");
    let head = "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 0 +X 0\n";
    std::fs::write(&empty, head).expect("a file");
    let problem = sky::open(empty.to_str().expect("a path"), 8).expect_err("no texels");
    assert!(problem.contains("0x0 texels"), "{problem}");
}

/// An EXR's head is not trusted: room for what this one says it has is more than there is.
#[test]
fn a_head_makes_no_room() {
    let file = file("huge.exr", [4, 2], &[[1.0; 3]; 8]);
    let mut bytes = std::fs::read(&file).expect("the file");
    let name = b"dataWindow\0box2i\0";
    let at = bytes.windows(name.len()).position(|w| w == name);
    // After the name and the length: the least column and row, and the greatest.
    let greatest = at.expect("a data window") + name.len() + 4 + 8;
    for corner in [greatest, greatest + 4] {
        bytes[corner..corner + 4].copy_from_slice(&((1_i32 << 29) - 1).to_le_bytes());
    }
    std::fs::write(&file, bytes).expect("a file");
    let problem = sky::open(&file, 16384).expect_err("too many texels");
    assert!(problem.contains("536870912x536870912 texels"), "{problem}");
}
