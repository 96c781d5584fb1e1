//! Hull carving, line and velocity fields, diffusion and sampling.
