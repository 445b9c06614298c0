//! Output files of an export: a folder, or an archive written as a stream.

use std::cell::Cell;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::rc::Rc;

use zip::write::{SimpleFileOptions, StreamWriter};
use zip::{CompressionMethod, ZipArchive, ZipWriter};

/// A sink for files in sequence.
pub trait Files {
    /// Begins a file; writes until the next call belong to it.
    fn begin(&mut self, name: &str) -> io::Result<&mut dyn Write>;

    /// Completes the last file and the archive.
    fn finish(&mut self) -> io::Result<()>;
}

pub struct Folder {
    path: PathBuf,
    open: Option<BufWriter<File>>,
}

impl Folder {
    pub const fn new(path: PathBuf) -> Self {
        Self { path, open: None }
    }

    fn close(&mut self) -> io::Result<()> {
        match self.open.take() {
            Some(mut file) => file.flush(),
            None => Ok(()),
        }
    }
}

impl Files for Folder {
    fn begin(&mut self, name: &str) -> io::Result<&mut dyn Write> {
        self.close()?;
        let file = File::create_new(self.path.join(name))?;
        Ok(self.open.insert(BufWriter::new(file)))
    }

    fn finish(&mut self) -> io::Result<()> {
        self.close()
    }
}

/// A zip archive written as a stream: the size of a file follows its data, with 64 bits.
pub struct Archive<W: Write> {
    zip: Option<ZipWriter<StreamWriter<Gate<W>>>>,
    is_shut: Rc<Cell<bool>>,
}

impl<W: Write> Archive<W> {
    pub fn new(out: W) -> Self {
        let is_shut = Rc::new(Cell::new(false));
        let gate = Gate { out, is_shut: Rc::clone(&is_shut) };
        Self { zip: Some(ZipWriter::new_stream(gate)), is_shut }
    }
}

impl<W: Write> Drop for Archive<W> {
    /// Drops the end record of an incomplete archive, which would otherwise look complete.
    fn drop(&mut self) {
        self.is_shut.set(true);
    }
}

/// Passes bytes on until shut, then discards them.
struct Gate<W> {
    out: W,
    is_shut: Rc<Cell<bool>>,
}

impl<W: Write> Write for Gate<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.is_shut.get() { Ok(bytes.len()) } else { self.out.write(bytes) }
    }

    fn flush(&mut self) -> io::Result<()> {
        if self.is_shut.get() { Ok(()) } else { self.out.flush() }
    }
}

impl<W: Write> Files for Archive<W> {
    fn begin(&mut self, name: &str) -> io::Result<&mut dyn Write> {
        let options = SimpleFileOptions::default()
            .compression_method(CompressionMethod::Deflated)
            .large_file(true);
        let zip = self.zip.as_mut().ok_or_else(|| io::Error::other("the archive is finished"))?;
        zip.start_file(name, options)?;
        Ok(zip)
    }

    fn finish(&mut self) -> io::Result<()> {
        if let Some(zip) = self.zip.take() {
            zip.finish()?.into_inner().flush()?;
        }
        Ok(())
    }
}

/// Whether an archive has more files than the index.
pub fn has_games(archive: &Path) -> io::Result<bool> {
    Ok(ZipArchive::new(File::open(archive)?)?.len() > 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn written(is_whole: bool) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut archive = Archive::new(&mut bytes);
        archive.begin("a.txt").and_then(|file| file.write_all(b"some text")).expect("memory");
        if is_whole {
            archive.finish().expect("memory");
        }
        drop(archive);
        bytes
    }

    #[test]
    fn an_archive_that_broke_off_does_not_look_whole() {
        let open = |bytes| zip::ZipArchive::new(io::Cursor::new(bytes));
        assert_eq!(open(written(true)).expect("an archive").len(), 1);
        assert!(open(written(false)).is_err());
    }

    #[test]
    fn a_folder_takes_files_and_overwrites_none() {
        let place = tempfile::tempdir().expect("a folder");
        let mut folder = Folder::new(place.path().to_owned());
        for name in ["a", "b"] {
            folder.begin(name).and_then(|file| file.write_all(name.as_bytes())).expect("written");
        }
        folder.finish().expect("written");
        for name in ["a", "b"] {
            assert_eq!(std::fs::read_to_string(place.path().join(name)).expect("a file"), name);
        }
        assert!(folder.begin("a").is_err());
    }
}
