//! The token of this user on this machine, which the trainer keeps in a file (PROTOCOL.md §3).

use super::LinkError;
use std::env::var_os;
use std::path::PathBuf;

/// Returns where trainers of this user keep their token.
fn user_token_path() -> PathBuf {
    let folder = |name: &str| var_os(name).map(PathBuf::from).unwrap_or_default();
    let cache = if cfg!(windows) {
        folder("LOCALAPPDATA")
    } else if cfg!(target_os = "macos") {
        folder("HOME").join("Library/Caches")
    } else {
        let named = folder("XDG_CACHE_HOME");
        if named.is_absolute() {
            named
        } else {
            folder("HOME").join(".cache")
        }
    };
    cache.join("ludus").join("token")
}

/// Returns the token of this user.
pub(super) fn user_token() -> Result<String, LinkError> {
    let path = user_token_path();
    let fail = |reason: String| LinkError::TokenFile {
        path: path.clone(),
        reason,
    };
    if is_for_others(&path).map_err(|error| fail(error.to_string()))? {
        return Err(fail("others may read it, too; delete it".to_owned()));
    }
    let text = std::fs::read_to_string(&path).map_err(|error| fail(error.to_string()))?;
    Ok(text.trim().to_owned())
}

/// Returns whether others than its owner have rights to a file. Who can read one without such rights
/// is its owner.
#[cfg(unix)]
fn is_for_others(path: &std::path::Path) -> std::io::Result<bool> {
    use std::os::unix::fs::MetadataExt;
    Ok(std::fs::metadata(path)?.mode() & 0o077 != 0)
}

/// Returns false: a home folder is its user's own on Windows.
#[cfg(not(unix))]
fn is_for_others(_: &std::path::Path) -> std::io::Result<bool> {
    Ok(false)
}
