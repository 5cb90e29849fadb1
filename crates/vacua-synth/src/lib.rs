//! Procedural volumes and meshes of any size with known answers.
