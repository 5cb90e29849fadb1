//! How surfaces are lit: from the camera, Blinn–Phong with the gradient of the field as normal.

/// Strengths of the light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightModel {
    /// Part of its colour that a surface has where it is seen edge-on.
    pub ambient: f32,
    /// What is added to that part where it faces the camera.
    pub diffuse: f32,
    /// White of the highlight.
    pub specular: f32,
    /// Exponent of the highlight, a power of two.
    pub shininess: u32,
}

/// The light of all renderers.
pub const LIGHT: LightModel = LightModel {
    ambient: 0.35,
    diffuse: 0.65,
    specular: 0.25,
    shininess: 32,
};
