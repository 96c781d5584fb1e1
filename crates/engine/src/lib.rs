//! The take on disk, the stage table, staleness, resume and executors.
