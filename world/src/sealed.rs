//! Files that know when they are damaged: magic, version, checksum (BLAKE3), content.

/// What keeps a sealed file from being opened.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SealError {
    /// It begins with other bytes: another kind of file.
    Magic,
    /// It is of this other version.
    Version(u32),
    /// It is cut off or changed.
    Damaged,
}

/// `content` behind its seal.
pub fn seal(magic: &[u8], version: u32, content: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(magic.len() + 36 + content.len());
    bytes.extend(magic);
    bytes.extend(version.to_le_bytes());
    bytes.extend(blake3::hash(content).as_bytes());
    bytes.extend(content);
    bytes
}

/// The content that [`seal`] put behind this magic and version.
///
/// # Errors
/// If it is something else, of another version, or damaged.
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
