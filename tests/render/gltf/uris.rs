//! Where buffers are.

use serde_json::json;

use super::files::{File, ROOM, near_origin, read, square, triangles};
use crate::folder;
use support::gltf::{load_gltf, read_gltf};

/// The square as JSON whose buffer is at this URI.
fn at(uri: &str) -> Vec<u8> {
    let mut file = square();
    file.json["buffers"] = json!([{ "byteLength": file.bytes.len(), "uri": uri }]);
    file.json.to_string().into_bytes()
}

pub fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let digits = |chunk: &[u8]| {
        let word = chunk
            .iter()
            .enumerate()
            .fold(0, |w, (i, b)| w | u32::from(*b) << (16 - 8 * i));
        let digit = |i: usize| char::from(DIGITS[(word >> (18 - 6 * i)) as usize & 63]);
        let text: String = (0..=chunk.len()).map(digit).collect();
        format!("{text:=<4}")
    };
    bytes.chunks(3).map(digits).collect()
}

#[test]
fn data_uris() {
    let bytes = square().bytes;
    let expected = triangles(&square().scene());
    let percent = percent_encoding::percent_encode(&bytes, percent_encoding::NON_ALPHANUMERIC);
    for uri in [
        format!("data:application/octet-stream;base64,{}", base64(&bytes)),
        format!("data:application/gltf-buffer;base64,{}", base64(&bytes)),
        format!("data:;base64,{}", base64(&bytes)),
        format!("data:application/octet-stream,{percent}"),
    ] {
        let loaded = read(&at(&uri)).expect("a square");
        assert_eq!(triangles(&near_origin(loaded.world)), expected);
    }
    for uri in [
        "data:",
        "data:application/octet-stream;base64,!!!!",
        "data:;base64,AAAA",
    ] {
        let problem = read(&at(uri)).err().expect("no bytes");
        assert!(problem.starts_with("buffer 0: "), "{problem}");
    }
}

/// Names of files are percent-encoded; where an exporter left a sign of its own as it is, that name is tried too.
#[test]
fn names_are_percent_encoded() {
    let folder = folder("names");
    let expected = triangles(&square().scene());
    for (name, uri) in [
        ("plain.bin", "plain.bin"),
        ("two words é.bin", "two%20words%20%C3%A9.bin"),
        ("two words é.bin", "two words é.bin"),
        ("100%25.bin", "100%25.bin"),
        ("half%.bin", "half%.bin"),
    ] {
        std::fs::write(folder.join(name), square().bytes).expect("a file");
        let file = folder.join("file.gltf");
        std::fs::write(&file, at(uri)).expect("a file");
        assert_eq!(
            triangles(&near_origin(load_gltf(&file).expect(uri).world)),
            expected,
            "{uri}"
        );
    }
}

#[test]
fn files_that_are_not_there() {
    let folder = folder("missing");
    std::fs::write(folder.join("short.bin"), &square().bytes[..8]).expect("a file");
    for (uri, expected) in [
        ("missing.bin", "\"missing.bin\""),
        ("missing%20one.bin", "\"missing one.bin\""),
        ("%FF.bin", "not UTF-8"),
        ("https://localhost/buffer.bin", "not a file's name"),
        ("file:///etc/hostname", "not a file's name"),
        ("../missing", "no file"),
        // No end to read to.
        ("/dev/zero", "no file"),
        ("short.bin", "found are 8"),
        ("\u{0}.bin", "no file"),
        ("two\nlines.bin", "no file"),
    ] {
        let problem = read_gltf(&at(uri), &folder, ROOM).err().expect(uri);
        assert!(problem.contains(expected), "{uri}: {problem}");
        assert!(!problem.contains('\n'), "{problem}");
    }
    let problem = load_gltf(&folder.join("missing.glb"))
        .err()
        .expect("no file");
    assert!(problem.contains("missing.glb: no such file"), "{problem}");
    let problem = load_gltf(&folder).err().expect("a folder");
    assert!(problem.contains("no such file"), "{problem}");
}

/// Only the first buffer is the file's own chunk; one without a place is a fault where it is used.
#[test]
fn buffers_without_a_place() {
    let mut file: File = square();
    let length = file.bytes.len();
    file.json["buffers"] = json!([{ "byteLength": length }, { "byteLength": 1_000_000_000 }]);
    file.scene();
    file.json["bufferViews"][0]["buffer"] = json!(1);
    let problem = file.read().err().expect("no bytes");
    assert!(problem.contains("buffer 1 has no data"), "{problem}");
}
