//! The compiled shaders. Sources lie beside their callers; `cargo xtask shaders` compiles them.

/// Ranges of macrocells.
pub(crate) const RANGES: &[u8] = include_bytes!("ranges.spv");
/// Which macrocells are active.
pub(crate) const CLASSIFY: &[u8] = include_bytes!("classify.spv");
/// A pass of the distance map.
pub(crate) const DISTANCE: &[u8] = include_bytes!("distance.spv");
/// The picture.
pub(crate) const MARCH: &[u8] = include_bytes!("march.spv");

/// All of them, by name.
#[cfg(test)]
pub(crate) const ALL: [(&str, &[u8]); 4] = [
    ("ranges", RANGES),
    ("classify", CLASSIFY),
    ("distance", DISTANCE),
    ("march", MARCH),
];
