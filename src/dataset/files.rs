//! Where the files of an export go: into a folder, or into an archive that is written from its beginning
//! to its end.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::PathBuf;

use zip::write::{SimpleFileOptions, StreamWriter};
use zip::{CompressionMethod, ZipWriter};

/// Takes files one after the other.
pub trait Files {
    /// Begins a file; what is written from now on belongs to it.
    ///
    /// # Errors
    /// Where it cannot be written; so for all functions here.
    fn begin(&mut self, name: &str) -> io::Result<&mut dyn Write>;

    /// All files are there.
    ///
    /// # Errors
    /// Where the last ones cannot be written.
    fn finish(&mut self) -> io::Result<()>;
}

/// A folder that exists.
pub struct Folder {
    path: PathBuf,
    open: Option<BufWriter<File>>,
}

impl Folder {
    /// Writes into the folder `path`.
    #[must_use]
    pub const fn new(path: PathBuf) -> Self {
        Self { path, open: None }
    }

    fn close(&mut self) -> io::Result<()> {
        match self.open.take() {
            Some(file) => file.into_inner().map_err(io::IntoInnerError::into_error)?.sync_all(),
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

/// A zip archive. Sizes stand behind each file (as nobody knows them before), in 64 bits.
pub struct Archive<W: Write> {
    zip: Option<ZipWriter<StreamWriter<W>>>,
}

impl<W: Write> Archive<W> {
    /// Writes an archive to `out`.
    pub fn new(out: W) -> Self {
        Self { zip: Some(ZipWriter::new_stream(out)) }
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
