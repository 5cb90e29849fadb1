//! Scene, camera, frame and the CPU integrators of vacua.
