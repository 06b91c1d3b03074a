//! How much memory there is.

/// Bytes.
pub(crate) const GIB: f64 = (1u64 << 30) as f64;

/// Memory that can still be had, bytes, where the system tells (Linux).
pub(crate) fn available_memory() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    let kib: f64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib * 1024.0)
}
