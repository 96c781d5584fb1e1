//! Where this process runs: for names that no other process has, and for the log.

use std::sync::LazyLock;

static MACHINE: LazyLock<String> = LazyLock::new(|| {
    let told = std::fs::read_to_string("/proc/sys/kernel/hostname").ok();
    let told = told.or_else(|| std::env::var("HOSTNAME").ok()).or_else(|| std::env::var("COMPUTERNAME").ok());
    name(&told.unwrap_or_default())
});

static NODE: LazyLock<String> =
    LazyLock::new(|| std::env::var("SLURMD_NODENAME").map_or_else(|_| MACHINE.clone(), |told| name(&told)));

/// The name of the machine.
pub fn machine() -> &'static str {
    &MACHINE
}

/// The name under which a scheduler knows the machine; its own name where none does.
pub fn node() -> &'static str {
    &NODE
}

/// A name that can stand in a file's name.
fn name(told: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
    let name: String = told.trim().chars().map(|c| if plain(c) { c } else { '_' }).collect();
    if name.trim_matches('.').is_empty() { "unknown".into() } else { name }
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_name_cannot_leave_its_folder() {
        assert_eq!(super::name("../n 1\n"), ".._n_1");
        assert_eq!([super::name(".."), super::name("")], ["unknown", "unknown"]);
    }
}
