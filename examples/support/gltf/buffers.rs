//! The bytes of buffers, wherever they are.

use std::{io::Read, path::Path};

use data_url::DataUrl;
use gltf::{
    Document,
    buffer::{Source, View},
};
use percent_encoding::percent_decode_str;

/// Each buffer's bytes, as many as it says it has; none where nothing says where they are.
pub struct Buffers(Vec<Option<Vec<u8>>>);

impl Buffers {
    pub fn load(
        document: &Document,
        mut blob: Option<Vec<u8>>,
        folder: &Path,
    ) -> Result<Self, String> {
        let mut read = |buffer: &gltf::Buffer<'_>| {
            let length = buffer.length();
            let bytes = match buffer.source() {
                Source::Bin if buffer.index() == 0 => blob.take(),
                // An extension may bring it.
                Source::Bin => None,
                Source::Uri(uri) => Some(read_uri(uri, folder, length as u64)?),
            };
            let Some(mut bytes) = bytes else {
                return Ok(None);
            };
            if bytes.len() < length {
                return Err(format!("{length} bytes, found are {}", bytes.len()));
            }
            bytes.truncate(length);
            Ok(Some(bytes))
        };
        document
            .buffers()
            .map(|b| read(&b).map_err(|e: String| format!("buffer {}: {e}", b.index())))
            .collect::<Result<_, _>>()
            .map(Self)
    }

    /// The bytes of a view.
    pub fn view(&self, view: &View<'_>) -> Result<&[u8], String> {
        let name = || format!("buffer view {}", view.index());
        let buffer = view.buffer().index();
        let bytes = self.0[buffer]
            .as_deref()
            .ok_or_else(|| format!("{}: buffer {buffer} has no data", name()))?;
        view.offset()
            .checked_add(view.length())
            .and_then(|end| bytes.get(view.offset()..end))
            .ok_or_else(|| {
                format!(
                    "{}: {} bytes from byte {} on, buffer {buffer} has {}",
                    name(),
                    view.length(),
                    view.offset(),
                    bytes.len()
                )
            })
    }
}

/// Reads a `data:` URI, or up to `most` bytes of a file in the folder.
pub fn read_uri(uri: &str, folder: &Path, most: u64) -> Result<Vec<u8>, String> {
    if uri
        .get(..5)
        .is_some_and(|scheme| scheme.eq_ignore_ascii_case("data:"))
    {
        let (bytes, _) = DataUrl::process(uri)
            .map_err(|e| format!("a data URI that is none: {e:?}"))?
            .decode_to_vec()
            .map_err(|e| format!("a data URI of broken base64: {e:?}"))?;
        return Ok(bytes);
    }
    if uri.contains("://") || uri.starts_with("file:") {
        return Err(format!("{uri:?} is not a file's name"));
    }
    let decoded = percent_decode_str(uri)
        .decode_utf8()
        .map_err(|_| format!("{uri:?} is not UTF-8"))?;
    // A percent sign may have been left as it is.
    let path = [decoded.as_ref(), uri]
        .map(|name| folder.join(name))
        .into_iter()
        .find(|path| path.is_file())
        .ok_or_else(|| format!("there is no file {:?}", decoded.as_ref()))?;
    let mut bytes = Vec::new();
    std::fs::File::open(&path)
        .and_then(|file| file.take(most).read_to_end(&mut bytes))
        .map_err(|e| format!("{}: {e}", path.display()))?;
    Ok(bytes)
}
