//! The containers of levels: the chunks of a `.glb`, and the files that a `.gltf` refers to.

use crate::faults::ImportError;
use base64::Engine;
use base64::alphabet::STANDARD;
use base64::engine::general_purpose::{GeneralPurpose, NO_PAD};
use percent_encoding::percent_decode_str;

const DATA_URI: &str = "data:";
const BASE64_MARK: &str = ";base64,";
/// Base64 with the standard alphabet (RFC 4648, section 4). Padding is cut off before; leftover bits are ignored.
const BASE64: GeneralPurpose = GeneralPurpose::new(&STANDARD, NO_PAD.with_decode_allow_trailing_bits(true));
/// Longest part of a URI that a message shows, characters.
const SHOWN_URI: usize = 200;

/// The files that a level refers to.
pub trait Files {
    /// Returns the content of a file.
    ///
    /// # Arguments
    /// - `path`: relative to the level, with `/` between its parts; percent-encoding is decoded. It may hold `..`.
    ///
    /// # Errors
    /// Why the file is not available, as a phrase that may follow the path and a colon.
    fn read(&self, path: &str) -> Result<Vec<u8>, String>;
}

/// No files: a level that came as bytes alone.
pub struct NoFiles;

impl Files for NoFiles {
    fn read(&self, _: &str) -> Result<Vec<u8>, String> {
        Err("only the level itself was sent: send a .zip of the level and its files, or one .glb".to_owned())
    }
}

/// The JSON of a glTF and its binary chunk.
pub(super) fn split(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>), ImportError> {
    if !bytes.starts_with(b"glTF") {
        return Ok((trimmed(bytes), None));
    }
    let header: &[u8; 12] = bytes.first_chunk().ok_or(ImportError::Container("its header is cut off"))?;
    let number = |at: usize| u32::from_le_bytes([header[at], header[at + 1], header[at + 2], header[at + 3]]);
    if number(4) != 2 {
        return Err(ImportError::GltfVersion(number(4).to_string()));
    }
    let contents = bytes.get(12..number(8) as usize).ok_or(ImportError::Container("it is cut off"))?;
    let json = Chunk::first(contents)?;
    if json.kind != b"JSON" {
        return Err(ImportError::Container("it does not begin with JSON"));
    }
    let mut rest = json.rest;
    // Chunks of other kinds are extensions.
    while !rest.is_empty() {
        let chunk = Chunk::first(rest)?;
        if chunk.kind == b"BIN\0" {
            return Ok((trimmed(json.content), Some(chunk.content)));
        }
        rest = chunk.rest;
    }
    Ok((trimmed(json.content), None))
}

/// JSON without a byte-order mark and without padding.
fn trimmed(json: &[u8]) -> &[u8] {
    let json = json.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(json);
    let end = json.iter().rposition(|byte| ![0, b' ', b'\n', b'\r', b'\t'].contains(byte));
    &json[..end.map_or(0, |last| last + 1)]
}

/// A chunk of a `.glb`, and the bytes that follow it.
struct Chunk<'a> {
    kind: &'a [u8; 4],
    content: &'a [u8],
    rest: &'a [u8],
}

impl<'a> Chunk<'a> {
    fn first(bytes: &'a [u8]) -> Result<Self, ImportError> {
        let chunk = bytes.split_first_chunk::<4>().and_then(|(len, rest)| {
            let (kind, rest) = rest.split_first_chunk::<4>()?;
            let (content, rest) = rest.split_at_checked(u32::from_le_bytes(*len) as usize)?;
            Some(Self { kind, content, rest })
        });
        chunk.ok_or(ImportError::Container("one of its chunks is cut off"))
    }
}

/// The content of the buffer `idx`, which is at `uri`.
pub(super) fn resolve(idx: usize, uri: &str, files: &dyn Files) -> Result<Vec<u8>, ImportError> {
    let uri = uri.trim();
    if uri.get(..DATA_URI.len()).is_some_and(|start| start.eq_ignore_ascii_case(DATA_URI)) {
        let text: String = uri.split_ascii_whitespace().collect();
        let text = text.split_once(BASE64_MARK).map(|(_, text)| text.trim_end_matches('='));
        return text.and_then(|text| BASE64.decode(text).ok()).ok_or(ImportError::Base64 { buffer: idx });
    }
    // Some exporters write backslashes, and queries against caches.
    let path = percent_decode_str(uri.split('?').next().unwrap_or(uri)).decode_utf8_lossy().replace('\\', "/");
    let fault = |problem: String| ImportError::ExternalBuffer { uri: path.chars().take(SHOWN_URI).collect(), problem };
    if uri.contains("://") {
        return Err(fault("a level's files lie beside it, not in a network: export the level as one .glb".to_owned()));
    }
    files.read(&path).map_err(fault)
}
