//! How the renderer works.

use super::GpuRenderer;
use crate::vulkan::Preference;

/// How rays find the faces of a boundary, or the cells of a mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Tracer {
    /// By a ray tracing pipeline, as the paper does it.
    Pipeline,
    /// By compute shaders that ask the structures.
    Query,
    /// By compute shaders that walk a hierarchy of our own, all rays of a subgroup together: on any device
    /// whose subgroups have eight lanes or more. For faces of the boundary only, not for cells of a mesh.
    Packets,
}

/// How the lanes of a subgroup look for the cells of a packed mesh, or for what is active ahead of them in
/// a grid; what they find is the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Search {
    /// Once for all of them, around the box that their places lie in: for rays next to each other.
    Together,
    /// Each on its own: for places all over a mesh, whose box would be most of it.
    Alone,
}

/// How acceleration structures are made (paper A §4.2.3).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StructureOptions {
    /// What they are built for.
    pub preference: Preference,
    /// Whether those over the boundary are copied to where they take less memory.
    pub compact: bool,
    /// Whether after an edit the shapes are moved instead of built anew, as long as they fit.
    pub refit: bool,
}

/// How the renderer works; pictures do not depend on it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GpuOptions {
    /// Farthest distance in the distance map, in macrocells, 1 to 127; 1 makes it a plain mask.
    pub reach: u8,
    /// Slices an image may have, if fewer than the device allows.
    pub max_layers: Option<u32>,
    /// How rays are traced by `mesh`; on a pipeline, where there is one, if not given.
    pub tracer: Option<Tracer>,
    /// How acceleration structures are made.
    pub structures: StructureOptions,
    /// Pictures of fewer pixels are not worth measuring for `auto`.
    pub least_pixels: usize,
    /// Bytes a part of a packed mesh may have in one buffer, if fewer than the device allows.
    pub max_buffer_bytes: Option<u64>,
    /// How rays search a packed mesh, and look ahead in a uniform grid.
    pub rays: Search,
    /// How a list of places searches a packed mesh.
    pub places: Search,
}

impl Default for GpuOptions {
    fn default() -> Self {
        Self {
            reach: 16,
            max_layers: None,
            tracer: None,
            structures: StructureOptions::default(),
            least_pixels: 1 << 18,
            max_buffer_bytes: None,
            rays: Search::Together,
            places: Search::Alone,
        }
    }
}

impl GpuRenderer {
    /// Changes how far the distance map reaches, in macrocells; 1 makes it a plain mask.
    pub fn set_reach(&mut self, reach: u8) {
        if reach != self.options.reach {
            self.options.reach = reach;
            self.skip = None;
        }
    }

    /// How `mesh` traces rays, if that was chosen.
    pub fn tracer(&self) -> Option<Tracer> {
        self.options.tracer
    }

    /// Changes how `mesh` traces rays.
    pub fn set_tracer(&mut self, tracer: Option<Tracer>) {
        self.options.tracer = tracer;
    }

    /// Changes how acceleration structures are made.
    pub fn set_structures(&mut self, structures: StructureOptions) {
        self.options.structures = structures;
    }

    /// Chooses how rays search a mesh, together unless told otherwise; pictures do not depend on it.
    pub fn set_search(&mut self, rays: Search) {
        self.options.rays = rays;
    }

    /// Chooses how a list of places searches a mesh, each on its own unless told otherwise.
    pub fn set_places_search(&mut self, places: Search) {
        self.options.places = places;
    }
}
