//! Files and folders that get their names when they are complete.

use std::fs::File;
use std::path::{Path, PathBuf};

use anyhow::Context;

/// A file or folder that is written under a name ending in `.partial`, and removed unless it is kept.
pub(super) struct Partial {
    to: PathBuf,
    now: PathBuf,
    is_kept: bool,
}

impl Partial {
    /// Begins a file, which will replace an existing one.
    pub(super) fn file(to: &Path) -> anyhow::Result<(Self, File)> {
        let is_other = to.metadata().is_ok_and(|found| !found.is_file());
        anyhow::ensure!(
            !is_other,
            "{} is no regular file and is not replaced: name another",
            to.display()
        );
        let this = Self::new(to);
        let file = File::create(&this.now);
        let file = file.with_context(|| format!("{} cannot be written", this.now.display()))?;
        Ok((this, file))
    }

    /// Begins a folder, which must not exist.
    pub(super) fn folder(to: &Path) -> anyhow::Result<(Self, PathBuf)> {
        anyhow::ensure!(!to.exists(), "{} exists and is not overwritten", to.display());
        let this = Self::new(to);
        let folder = this.now.clone();
        std::fs::create_dir(&folder)
            .with_context(|| format!("{} cannot be created", folder.display()))?;
        Ok((this, folder))
    }

    fn new(to: &Path) -> Self {
        let mut partial = to.as_os_str().to_owned();
        partial.push(".partial");
        Self { to: to.to_owned(), now: partial.into(), is_kept: false }
    }

    /// Renames it to its final name.
    pub(super) fn keep(mut self) -> anyhow::Result<()> {
        std::fs::rename(&self.now, &self.to)
            .with_context(|| format!("{} cannot be written", self.to.display()))?;
        self.is_kept = true;
        Ok(())
    }

    /// Writes a whole file.
    pub(super) fn write(to: &Path, bytes: &[u8]) -> anyhow::Result<()> {
        let (partial, mut file) = Self::file(to)?;
        std::io::Write::write_all(&mut file, bytes)
            .with_context(|| format!("{} cannot be written", to.display()))?;
        partial.keep()
    }
}

impl Drop for Partial {
    fn drop(&mut self) {
        if !self.is_kept {
            // Failures are ignored: the name shows that the file is incomplete.
            let _ = std::fs::remove_file(&self.now);
            let _ = std::fs::remove_dir_all(&self.now);
        }
    }
}
