//! Sealed files: magic, version, checksum (BLAKE3) and content. The checksum detects damage.

/// Why a sealed file cannot be opened.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SealError {
    /// The file begins with another magic, so it is another kind of file.
    Magic,
    /// The file has this version instead of the expected one.
    Version(u32),
    /// The file is truncated or its checksum does not match.
    Damaged,
}

/// Prepends magic, version and checksum to `content`.
pub fn seal(magic: &[u8], version: u32, content: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(magic.len() + 36 + content.len());
    bytes.extend(magic);
    bytes.extend(version.to_le_bytes());
    bytes.extend(blake3::hash(content).as_bytes());
    bytes.extend(content);
    bytes
}

/// Returns the content that [`seal`] wrote with this magic and version.
///
/// # Errors
/// If the magic or the version differs, or the file is damaged.
pub fn open<'a>(magic: &[u8], version: u32, bytes: &'a [u8]) -> Result<&'a [u8], SealError> {
    let rest = bytes.strip_prefix(magic).ok_or(SealError::Magic)?;
    let (found, rest) = rest.split_first_chunk::<4>().ok_or(SealError::Damaged)?;
    let found = u32::from_le_bytes(*found);
    if found != version {
        return Err(SealError::Version(found));
    }
    let (checksum, content) = rest.split_first_chunk::<32>().ok_or(SealError::Damaged)?;
    if blake3::hash(content).as_bytes() == checksum { Ok(content) } else { Err(SealError::Damaged) }
}
