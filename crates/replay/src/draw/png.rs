//! Scenes as PNG.

use std::sync::{Arc, LazyLock};

use resvg::tiny_skia::{Pixmap, Transform};
use resvg::usvg::{Options, Tree, fontdb};

use super::font;
use super::scene::Scene;
use super::svg::svg;

/// The maximum number of pixels of a picture, at four bytes of memory each.
pub const PNG_PIXELS_MAX: f64 = 100_000_000.0;

/// A picture is too large.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(
    "a picture of {width:.0} × {height:.0} pixels is larger than the limit png_pixels_max = {PNG_PIXELS_MAX:.0}: take a \
     smaller --scale, or write SVG"
)]
pub struct TooLarge {
    width: f64,
    height: f64,
}

static FONTS: LazyLock<Arc<fontdb::Database>> = LazyLock::new(|| {
    let mut fonts = fontdb::Database::new();
    fonts.load_font_data(font::FILE.to_vec());
    Arc::new(fonts)
});

/// Renders a scene as a PNG file with `scale` pixels for each unit. Fonts of the machine are not used.
///
/// # Errors
/// If the picture has more than [`PNG_PIXELS_MAX`] pixels.
pub fn png(scene: &Scene, scale: f64) -> Result<Vec<u8>, TooLarge> {
    let (width, height) = ((scene.width * scale).ceil(), (scene.height * scale).ceil());
    let too_large = TooLarge { width, height };
    if width * height > PNG_PIXELS_MAX {
        return Err(too_large);
    }
    let options = Options {
        font_family: font::FAMILY.to_owned(),
        fontdb: Arc::clone(&FONTS),
        ..Options::default()
    };
    let tree = Tree::from_str(&svg(scene), &options).expect("our own SVG");
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked above")]
    let mut pixels = Pixmap::new(width as u32, height as u32).ok_or(too_large)?;
    #[expect(clippy::cast_possible_truncation, reason = "a small number")]
    let scale = scale as f32;
    resvg::render(&tree, Transform::from_scale(scale, scale), &mut pixels.as_mut());
    Ok(pixels.encode_png().expect("a buffer takes everything"))
}
