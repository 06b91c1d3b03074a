//! Available memory.

use std::fs::read_to_string;
use std::path::Path;

/// Bytes of one GiB.
pub const GIB: f64 = (1u64 << 30) as f64;

/// Available memory, bytes, if the system reports it (Linux): the minimum over the machine, this
/// process and its container.
pub fn available_memory() -> Option<f64> {
    let groups = read_to_string("/proc/self/cgroup").ok();
    let container = groups.and_then(|groups| of_groups(&groups, Path::new("/sys/fs/cgroup")));
    let all = [of_machine(), of_process(), container];
    all.into_iter().flatten().reduce(f64::min).map(|bytes| bytes.max(0.0))
}

/// Checks that `needed` bytes of memory are available; else the error has the rest of a sentence
/// about them.
///
/// # Errors
/// The rest of a sentence: how much is needed and available.
pub fn check_memory(needed: f64, available: Option<f64>) -> std::result::Result<(), String> {
    match available {
        Some(available) if needed > available => {
            let [needed, available] = [needed, available].map(|bytes| bytes / GIB);
            Err(format!("about {needed:.1} GiB of memory, but {available:.1} GiB are available"))
        }
        _ => Ok(()),
    }
}

fn of_machine() -> Option<f64> {
    kib(&read_to_string("/proc/meminfo").ok()?, "MemAvailable:")
}

/// Address space left below the limit of `ulimit -v`, bytes.
fn of_process() -> Option<f64> {
    let limits = read_to_string("/proc/self/limits").ok()?;
    let limit = limits.lines().find_map(|line| line.strip_prefix("Max address space"))?;
    let limit: f64 = limit.split_whitespace().next()?.parse().ok()?;
    Some(limit - kib(&read_to_string("/proc/self/status").ok()?, "VmSize:")?)
}

/// Memory left below the lowest limit of this process's control groups (version 2), folders of
/// `root`; bytes.
fn of_groups(groups: &str, root: &Path) -> Option<f64> {
    let group = groups.lines().find_map(|line| line.strip_prefix("0::/"))?;
    let left = |folder: &Path| {
        let number = |name: &str| -> Option<f64> {
            read_to_string(folder.join(name)).ok()?.trim().parse().ok()
        };
        let limit = number("memory.max")?; // `max` if there is no limit
        let stat = read_to_string(folder.join("memory.stat")).ok()?;
        // Cached pages of files, which the system frees on demand.
        let cache = stat.lines().find_map(|line| line.strip_prefix("inactive_file "));
        let cache: f64 = cache.and_then(|bytes| bytes.parse().ok()).unwrap_or(0.0);
        Some(limit - number("memory.current")? + cache)
    };
    let own = root.join(group);
    let folders = own.ancestors().take_while(|folder| folder.starts_with(root));
    folders.filter_map(left).reduce(f64::min)
}

/// The number of KiB after `name`, in bytes.
fn kib(text: &str, name: &str) -> Option<f64> {
    let number = text.lines().find_map(|line| line.strip_prefix(name))?;
    let kib: f64 = number.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib * 1024.0)
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn available_memory_is_positive_and_below_that_of_the_machine() {
        let available = available_memory().unwrap();
        let all = kib(&read_to_string("/proc/meminfo").unwrap(), "MemTotal:").unwrap();
        assert!(available > 0.0 && available < all, "{available} of {all} bytes");
    }

    #[test]
    fn lowest_limit_of_all_groups_counts() {
        let root = tempfile::tempdir().unwrap();
        let folder = root.path().join("a/b");
        std::fs::create_dir_all(&folder).unwrap();
        let write = |folder: &Path, limit: &str, used: &str| {
            let stat = "anon 10\ninactive_file 30\nactive_file 7\n";
            for (name, text) in
                [("memory.max", limit), ("memory.current", used), ("memory.stat", stat)]
            {
                std::fs::write(folder.join(name), text).unwrap();
            }
        };
        let left = |groups| of_groups(groups, root.path());
        assert_eq!(left("0::/a/b\n"), None);
        write(&folder, "max\n", "400\n");
        assert_eq!(left("0::/a/b\n"), None);
        write(&root.path().join("a"), "1000\n", "500\n");
        assert_eq!(left("4:memory:/x\n0::/a/b\n"), Some(530.0));
        write(&folder, "450\n", "400\n");
        assert_eq!((left("0::/a/b\n"), left("0::/a\n")), (Some(80.0), Some(530.0)));
        assert_eq!((left("0::/\n"), left("4:memory:/a\n")), (None, None));
    }
}
