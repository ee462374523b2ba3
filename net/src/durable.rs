//! Files that survive a crash: whole or not at all, and on the disk when the call returns.

use std::fs::File;
use std::io::{Result, Write};
use std::path::Path;

/// Replaces the file at `path` by `bytes`. After a crash, the file has either its old or its new content. If that
/// fails, the old file is kept.
pub fn replace(path: &Path, bytes: &[u8]) -> Result<()> {
    let beside = path.with_extension("tmp");
    let written = File::create(&beside).and_then(|mut file| {
        file.write_all(bytes)?;
        file.sync_all()
    });
    let replaced = written.and_then(|()| std::fs::rename(&beside, path));
    if replaced.is_err() {
        // On a full disk, the partial file would take space that is needed.
        let _ = std::fs::remove_file(&beside);
    }
    replaced?;
    sync_folder_of(path)
}

/// Removes a file.
pub fn remove(path: &Path) -> Result<()> {
    std::fs::remove_file(path)?;
    sync_folder_of(path)
}

/// Makes a change of a folder's entries durable.
fn sync_folder_of(path: &Path) -> Result<()> {
    // Other systems cannot open folders as files.
    if cfg!(unix) {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        File::open(folder)?.sync_all()?;
    }
    Ok(())
}
