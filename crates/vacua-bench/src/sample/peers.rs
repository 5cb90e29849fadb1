//! The packed form and what it is compared with, behind one interface.

use vacua_pack::block::Places;
use vacua_pack::reference::{
    Cells, LinkedBvh, MinMaxBvh, RaySamples, Reference, ReferenceError, SharedFaces, TetMarch,
    UserGeometry,
};
use vacua_pack::{BlockSampler, PackedField, PackedMesh};
use vacua_simd::LANES;

/// One way to hold a mesh, ready to be sampled.
pub(super) enum Peer<'a> {
    /// The packed form.
    Packed(BlockSampler<'a>),
    /// A reference encoding.
    Reference(&'a dyn Reference),
}

impl<'a> Peer<'a> {
    /// The packed form of a mesh.
    pub fn packed(mesh: &'a PackedMesh, field: &'a PackedField) -> Self {
        Self::Packed(BlockSampler::new(mesh, field, None))
    }

    /// Values at sixteen places, and the lanes that have one.
    #[inline]
    pub fn sample(&self, at: &Places) -> ([f32; LANES], u16) {
        match self {
            Self::Packed(sampler) => {
                let sampled = sampler.sample(at, u16::MAX);
                (sampled.values, sampled.valid)
            }
            Self::Reference(reference) => {
                let found = reference.sample(at, u16::MAX);
                (found.values, found.valid)
            }
        }
    }

    /// Values of consecutive samples of a ray; NaN where there is none.
    pub fn sample_ray(&self, ray: &RaySamples, values: &mut [f32]) {
        let sampler = match self {
            Self::Packed(sampler) => sampler,
            Self::Reference(reference) => return reference.sample_ray(ray, values),
        };
        for (i, sixteen) in (0u32..).zip(values.chunks_mut(LANES)) {
            let lanes = ((1u32 << sixteen.len()) - 1) as u16;
            let sampled = sampler.sample(&ray.places(ray.first + LANES as u32 * i), lanes);
            for (lane, value) in sixteen.iter_mut().enumerate() {
                let valid = sampled.valid >> lane & 1 == 1;
                *value = if valid {
                    sampled.values[lane]
                } else {
                    f32::NAN
                };
            }
        }
    }
}

/// The reference encodings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    OsprayOne,
    OsprayTwo,
    UserGeometry,
    SharedFaces,
    TetMarch,
}

impl Kind {
    /// All of them.
    pub const ALL: [Self; 5] = [
        Self::OsprayOne,
        Self::OsprayTwo,
        Self::UserGeometry,
        Self::SharedFaces,
        Self::TetMarch,
    ];
    /// Those of Tables 4 and 6.
    pub const TABLE_6: [Self; 3] = [Self::UserGeometry, Self::SharedFaces, Self::TetMarch];

    /// Its name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::OsprayOne => "OSPRay 1.8.5",
            Self::OsprayTwo => "OSPRay 2.x (Open VKL)",
            Self::UserGeometry => "user geometry",
            Self::SharedFaces => "shared faces",
            Self::TetMarch => "tet marching",
        }
    }

    /// Bytes a cell that building takes at most, about.
    pub const fn build_bytes_per_cell(self) -> u64 {
        match self {
            Self::OsprayOne | Self::OsprayTwo | Self::UserGeometry => 600,
            Self::SharedFaces => 1200,
            Self::TetMarch => 300,
        }
    }

    /// Builds it.
    pub fn build(self, cells: &Cells) -> Result<Box<dyn Reference>, ReferenceError> {
        Ok(match self {
            Self::OsprayOne => Box::new(MinMaxBvh::new(cells)),
            Self::OsprayTwo => Box::new(LinkedBvh::new(cells)),
            Self::UserGeometry => Box::new(UserGeometry::new(cells)),
            Self::SharedFaces => Box::new(SharedFaces::new(cells)?),
            Self::TetMarch => Box::new(TetMarch::new(cells)?),
        })
    }
}
