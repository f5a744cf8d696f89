//! A file's JSON and its binary chunk, checked for what the `gltf` crate relies on.

use gltf::{
    Document, Gltf, Semantic,
    json::validation::{Checked, Error, Validate},
};

/// Extensions that a file may require: those that are read, and those that change nothing of what is read.
const SUPPORTED: &[&str] = &[
    "EXT_mesh_gpu_instancing",
    "KHR_lights_punctual",
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_dispersion",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_iridescence",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_materials_unlit",
    "KHR_materials_variants",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
];

const HEADER_BYTES: usize = 12;
const CHUNK_HEADER_BYTES: usize = 8;

/// A document whose indices all point somewhere, and its binary chunk.
pub fn parse(bytes: &[u8]) -> Result<(Document, Option<Vec<u8>>), String> {
    let bytes = if bytes.starts_with(b"glTF") {
        whole_binary(bytes)?
    } else {
        bytes
    };
    let Gltf { document, blob } =
        Gltf::from_slice_without_validation(bytes).map_err(|e| format!("not a glTF file: {e}"))?;
    let json = document.as_json();
    let version = &json.asset.version;
    let needed = json.asset.min_version.as_ref().unwrap_or(version);
    if !version.starts_with("2.") || (json.asset.min_version.is_some() && needed != "2.0") {
        return Err(format!("glTF version {needed:?}, accepted is 2.0"));
    }
    let unsupported = |name: &&String| !SUPPORTED.contains(&name.as_str());
    if let Some(name) = json.extensions_required.iter().find(unsupported) {
        return Err(format!(
            "requires the extension {name}, which is not supported"
        ));
    }
    check_indices(&document)?;
    Ok((document, blob))
}

/// Header and first chunk, cut to the length that the header says.
fn whole_binary(bytes: &[u8]) -> Result<&[u8], String> {
    let length = bytes
        .get(8..HEADER_BYTES)
        .and_then(|b| b.try_into().ok())
        .map(u32::from_le_bytes)
        .ok_or("a binary glTF file without a header")? as usize;
    if length < HEADER_BYTES + CHUNK_HEADER_BYTES {
        return Err(format!(
            "a binary glTF file of {length} bytes, its header says"
        ));
    }
    bytes
        .get(..length)
        .ok_or_else(|| format!("truncated: {} bytes, its header says {length}", bytes.len()))
}

fn check_indices(document: &Document) -> Result<(), String> {
    let json = document.as_json();
    // The crate's own check follows these before it knows that they point somewhere.
    for (i, mesh) in json.meshes.iter().enumerate() {
        for (k, primitive) in mesh.primitives.iter().enumerate() {
            let positions = primitive
                .attributes
                .get(&Checked::Valid(Semantic::Positions));
            if positions.is_some_and(|p| p.value() >= json.accessors.len()) {
                return Err(format!(
                    "mesh {i}, primitive {k}: there is no accessor of its positions"
                ));
            }
        }
    }
    let mut found = Vec::new();
    json.validate(json, gltf::json::Path::new, &mut |path, error| {
        let path = path();
        let name = path.as_str();
        // Extensions are checked above. Bounds of positions are not used, nor are primitives without any; a texture without
        // a source has one in an extension.
        let unused = name.ends_with("[\"POSITION\"].min")
            || name.ends_with("[\"POSITION\"].max")
            || name.ends_with(".attributes[\"POSITION\"]") && error == Error::Missing;
        if error != Error::Unsupported && !unused {
            found.push(format!("{name}: {}", error.to_string().to_lowercase()));
        }
    });
    match found.first() {
        None => Ok(()),
        Some(first) if found.len() == 1 => Err(first.clone()),
        Some(first) => Err(format!("{first}, and {} faults more", found.len() - 1)),
    }
}
