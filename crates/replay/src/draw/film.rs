//! Frames as an animation: GIF, and Y4M for video encoders.

use std::borrow::Cow;
use std::io::Write;

use gif::{DisposalMethod, Encoder, EncodingError, Frame, Repeat};

use super::canvas::{Canvas, palette};

/// The maximum frame rate: a GIF counts hundredths of a second, and viewers slow delays below two of them down.
pub const FRAMES_PER_SECOND_MAX: u16 = 50;

/// An animation cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum FilmError {
    /// The file cannot be written.
    #[error(transparent)]
    Io(#[from] std::io::Error),
    /// A frame does not fit into a GIF.
    #[error("a GIF cannot have this frame: {0}")]
    Gif(EncodingError),
}

impl From<EncodingError> for FilmError {
    fn from(error: EncodingError) -> Self {
        match error {
            EncodingError::Io(error) => Self::Io(error),
            error => Self::Gif(error),
        }
    }
}

/// An animation that is being written. All frames have the size of the first.
pub trait Film {
    /// Adds a frame.
    ///
    /// # Errors
    /// If it cannot be written.
    fn frame(&mut self, canvas: &Canvas) -> Result<(), FilmError>;

    /// Completes the file.
    ///
    /// # Errors
    /// If it cannot be written.
    fn finish(self: Box<Self>) -> Result<(), FilmError>;
}

/// A GIF that repeats for ever. Each frame contains only the rectangle that changed.
pub struct Gif<W: Write> {
    encoder: Encoder<W>,
    before: Option<Vec<u8>>,
    delay: u16,
}

/// The index of the transparent colour, which leaves the previous pixel.
const SAME: u8 = 63;

impl<W: Write> Gif<W> {
    /// Begins a GIF of frames of this size.
    ///
    /// # Errors
    /// If it cannot be written, or a side is longer than a GIF allows.
    pub fn new(out: W, canvas: &Canvas, per_second: u16) -> Result<Self, FilmError> {
        let side = |side: usize| u16::try_from(side).map_err(|_| too_long());
        let mut colors: Vec<u8> = Vec::new();
        for color in palette() {
            colors.extend([color.0, color.1, color.2]);
        }
        colors.resize(64 * 3, 0);
        let (width, height) = (side(canvas.width())?, side(canvas.height())?);
        let mut encoder = Encoder::new(out, width, height, &colors)?;
        encoder.set_repeat(Repeat::Infinite)?;
        Ok(Self { encoder, before: None, delay: delay(per_second) })
    }
}

fn too_long() -> FilmError {
    FilmError::Io(std::io::Error::other("a GIF has at most 65535 pixels on a side"))
}

/// The delay of a frame in hundredths of a second.
fn delay(per_second: u16) -> u16 {
    let per_second = per_second.clamp(1, FRAMES_PER_SECOND_MAX);
    (100 + per_second / 2) / per_second
}

impl<W: Write> Film for Gif<W> {
    fn frame(&mut self, canvas: &Canvas) -> Result<(), FilmError> {
        let (width, now) = (canvas.width(), canvas.pixels());
        let before = self.before.get_or_insert_with(|| vec![SAME; now.len()]);
        let changed = changed(before, now, width);
        let rows = changed.top..changed.top + changed.height;
        let mut buffer = Vec::with_capacity(changed.width * changed.height);
        for row in rows {
            let from = row * width + changed.left;
            let pairs = before[from..].iter().zip(&now[from..]).take(changed.width);
            buffer.extend(pairs.map(|(before, now)| if before == now { SAME } else { *now }));
        }
        before.copy_from_slice(now);
        let side = |side: usize| u16::try_from(side).map_err(|_| too_long());
        self.encoder.write_frame(&Frame {
            delay: self.delay,
            dispose: DisposalMethod::Keep,
            transparent: Some(SAME),
            left: side(changed.left)?,
            top: side(changed.top)?,
            width: side(changed.width)?,
            height: side(changed.height)?,
            buffer: Cow::Owned(buffer),
            ..Frame::default()
        })?;
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<(), FilmError> {
        Ok(self.encoder.into_inner()?.flush()?)
    }
}

struct Changed {
    left: usize,
    top: usize,
    width: usize,
    height: usize,
}

/// The smallest rectangle around all pixels that differ; one pixel if none does, as a frame cannot be empty.
fn changed(before: &[u8], now: &[u8], width: usize) -> Changed {
    let (mut left, mut right) = (width, 0);
    let (mut top, mut bottom) = (usize::MAX, 0);
    for (number, (before, now)) in before.chunks(width).zip(now.chunks(width)).enumerate() {
        let differs = |(a, b): (&u8, &u8)| a != b;
        let Some(first) = before.iter().zip(now).position(differs) else { continue };
        let last = before.iter().zip(now).rposition(differs).unwrap_or(first);
        (left, right) = (left.min(first), right.max(last));
        (top, bottom) = (top.min(number), number);
    }
    if top == usize::MAX {
        return Changed { left: 0, top: 0, width: 1, height: 1 };
    }
    Changed { left, top, width: right - left + 1, height: bottom - top + 1 }
}

/// Uncompressed video for the input pipe of encoders: YUV4MPEG2 with full colour (4:4:4), ITU-R BT.601.
pub struct Y4m<W: Write> {
    out: W,
    /// Luma and the two chromas of each colour.
    colors: Vec<[u8; 3]>,
    plane: Vec<u8>,
}

impl<W: Write> Y4m<W> {
    /// Begins a video of frames of this size.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn new(mut out: W, canvas: &Canvas, per_second: u16) -> Result<Self, FilmError> {
        let (width, height) = (canvas.width(), canvas.height());
        writeln!(out, "YUV4MPEG2 W{width} H{height} F{per_second}:1 Ip A1:1 C444")?;
        let colors = palette().into_iter().map(|color| {
            let [r, g, b] = [color.0, color.1, color.2].map(f64::from);
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "16..=240")]
            [
                16.0 + (65.481 * r + 128.553 * g + 24.966 * b) / 255.0,
                128.0 + (-37.797 * r - 74.203 * g + 112.0 * b) / 255.0,
                128.0 + (112.0 * r - 93.786 * g - 18.214 * b) / 255.0,
            ]
            .map(|part| part.round() as u8)
        });
        Ok(Self { out, colors: colors.collect(), plane: Vec::new() })
    }
}

impl<W: Write> Film for Y4m<W> {
    fn frame(&mut self, canvas: &Canvas) -> Result<(), FilmError> {
        self.out.write_all(b"FRAME\n")?;
        for part in 0..3 {
            let pixels = canvas.pixels().iter();
            self.plane.clear();
            self.plane.extend(pixels.map(|&pixel| self.colors[usize::from(pixel)][part]));
            self.out.write_all(&self.plane)?;
        }
        Ok(())
    }

    fn finish(mut self: Box<Self>) -> Result<(), FilmError> {
        Ok(self.out.flush()?)
    }
}

#[cfg(test)]
mod tests {
    use super::super::palette::{Color, PAPER};
    use super::super::scene::{Area, Paint, Scene};
    use super::*;

    /// A square that moves to the right, then stands still.
    fn canvases() -> Vec<Canvas> {
        let mut canvas = Canvas::new(&Scene::new(20.0, 10.0, ""));
        let places = [2.0, 6.0, 10.0, 10.0];
        let drawn = places.map(|x| {
            let mut scene = Scene::new(20.0, 10.0, "");
            scene.rect(Area::new(x, 3.0, 4.0, 4.0), Paint::fill(Color::BLUE));
            canvas.draw(&scene);
            canvas.clone()
        });
        drawn.into()
    }

    #[test]
    fn a_gif_decodes_to_the_frames_that_were_drawn() {
        let canvases = canvases();
        let mut bytes = Vec::new();
        let mut film = Box::new(Gif::new(&mut bytes, &canvases[0], 8).expect("a buffer"));
        for canvas in &canvases {
            film.frame(canvas).expect("a buffer");
        }
        film.finish().expect("a buffer");

        let decoder = gif::Decoder::new(bytes.as_slice()).expect("a GIF");
        let palette = decoder.global_palette().expect("one palette").to_vec();
        assert_eq!(palette[..3], [PAPER.0, PAPER.1, PAPER.2]);
        let (mut shown, mut count) = (vec![SAME; 200], 0);
        let mut written = Vec::new();
        for frame in decoder {
            let frame = frame.expect("a frame");
            assert_eq!(frame.delay, 13, "hundredths of a second at 8 frames a second");
            let width = usize::from(frame.width);
            for (i, row) in frame.buffer.chunks(width).enumerate() {
                for (j, &pixel) in row.iter().enumerate() {
                    let at = (usize::from(frame.top) + i) * 20 + usize::from(frame.left) + j;
                    if frame.transparent != Some(pixel) {
                        shown[at] = pixel;
                    }
                }
            }
            written.push((frame.width, frame.height));
            assert_eq!(shown, canvases[count].pixels(), "frame {count}");
            count += 1;
        }
        assert_eq!(count, canvases.len());
        assert_eq!(written, [(20, 10), (8, 4), (8, 4), (1, 1)], "only what changed");
    }

    #[test]
    fn a_video_has_its_header_and_three_planes_a_frame() {
        let canvases = canvases();
        let mut bytes = Vec::new();
        let mut film = Box::new(Y4m::new(&mut bytes, &canvases[0], 25).expect("a buffer"));
        for canvas in &canvases {
            film.frame(canvas).expect("a buffer");
        }
        film.finish().expect("a buffer");
        let header = b"YUV4MPEG2 W20 H10 F25:1 Ip A1:1 C444\n";
        assert!(bytes.starts_with(header));
        let frames = &bytes[header.len()..];
        let frame = b"FRAME\n".len() + 3 * 200;
        assert_eq!(frames.len(), canvases.len() * frame);
        assert!(frames.chunks(frame).all(|frame| frame.starts_with(b"FRAME\n")));
        // The expected planes of white, and of the blue of the square: (0, 114, 178).
        let planes = &frames[6..frame];
        assert_eq!([planes[0], planes[200], planes[400]], [235, 128, 128]);
        let inside = 4 * 20 + 3;
        assert_eq!([planes[inside], planes[200 + inside], planes[400 + inside]], [91, 173, 73]);
    }

    #[test]
    fn delays_are_whole_hundredths_of_a_second() {
        assert_eq!([1, 2, 4, 8, 50, 999].map(delay), [100, 50, 25, 13, 2, 2]);
    }
}
