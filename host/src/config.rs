//! What is the same on every call: a configuration file, and variables of the environment that overrule it. Options overrule both.

use anyhow::{Context, Result, anyhow};
use serde::Deserialize;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// The keys of the file; the variable of each is SKIN_ and its name in capitals.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Config {
    /// The board's port, where neither a port nor a serial number is asked for.
    pub(crate) port: Option<String>,
    /// Its serial number.
    pub(crate) serial: Option<String>,
    /// The sheet's file; relative to the configuration file.
    pub(crate) sheet: Option<PathBuf>,
    /// The calibration's file; relative to the configuration file.
    pub(crate) calibration: Option<PathBuf>,
    /// Port of the page.
    pub(crate) listen: Option<u16>,
    /// Whether the page is opened in the browser.
    pub(crate) open: Option<bool>,
}

pub(crate) type Variable<'a> = &'a dyn Fn(&str) -> Option<OsString>;

impl Config {
    /// Where the file is or would be; it need not be there.
    pub(crate) fn file() -> Option<PathBuf> {
        let variable = |name: &str| std::env::var_os(name).filter(|v| !v.is_empty());
        variable("SKIN_CONFIG").map(PathBuf::from).or_else(|| place(&variable))
    }

    /// Of this computer's user.
    ///
    /// # Errors
    /// A file or a variable that cannot be understood; SKIN_CONFIG names a file that is not there.
    pub(crate) fn load() -> Result<Self> {
        let variable = |name: &str| std::env::var_os(name).filter(|v| !v.is_empty());
        let is_named = variable("SKIN_CONFIG").is_some();
        let path = Self::file();
        let text = match &path {
            Some(path) if is_named || path.exists() => {
                let text = ::forward::whole::text(path);
                text.with_context(|| format!("{}: the configuration cannot be read", path.display()))?
            }
            _ => String::new(),
        };
        Self::of(&text, path.as_deref(), &variable)
    }

    /// Of the file's text and of variables.
    ///
    /// # Errors
    /// One of them cannot be understood.
    pub(crate) fn of(text: &str, path: Option<&Path>, variable: Variable<'_>) -> Result<Self> {
        let file = path.map_or(String::new(), |p| p.display().to_string());
        let mut config: Self = toml::from_str(text).with_context(|| format!("{file}: the configuration"))?;
        let folder = path.and_then(Path::parent).unwrap_or(Path::new(""));
        for path in [&mut config.sheet, &mut config.calibration].into_iter().flatten() {
            *path = folder.join(&*path);
        }
        let text = |name: &str| variable(name).map(|v| v.to_string_lossy().into_owned());
        let (port, serial) = (text("SKIN_PORT"), text("SKIN_SERIAL"));
        if port.is_some() || serial.is_some() {
            // One of them overrules both of the file.
            (config.port, config.serial) = (port, serial);
        }
        let file = |name: &str, of_file: Option<PathBuf>| variable(name).map(PathBuf::from).or(of_file);
        config.sheet = file("SKIN_SHEET", config.sheet);
        config.calibration = file("SKIN_CALIBRATION", config.calibration);
        config.listen = parsed("SKIN_LISTEN", text("SKIN_LISTEN"), "a port from 0 to 65535")?.or(config.listen);
        config.open = parsed("SKIN_OPEN", text("SKIN_OPEN"), "true or false")?.or(config.open);
        if config.port.is_some() && config.serial.is_some() {
            return Err(anyhow!(
                "the configuration has a port and a serial number; leave one of them out"
            ));
        }
        Ok(config)
    }
}

fn parsed<T: std::str::FromStr>(name: &str, text: Option<String>, wanted: &str) -> Result<Option<T>> {
    let parse = |text: String| text.parse().map_err(|_| anyhow!("{name} is \"{text}\"; give {wanted}"));
    text.map(parse).transpose()
}

/// Where the file is, on this system.
fn place(variable: Variable<'_>) -> Option<PathBuf> {
    let absolute = |name: &str| variable(name).map(PathBuf::from).filter(|p| p.is_absolute());
    let folder = if cfg!(windows) {
        absolute("APPDATA")
    } else {
        absolute("XDG_CONFIG_HOME").or_else(|| absolute("HOME").map(|home| home.join(".config")))
    };
    folder.map(|folder| folder.join("skin").join("config.toml"))
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "serial = \"A7\"\nsheet = \"square.toml\"\nlisten = 9000\nopen = false\n";

    fn of(text: &str, variables: &[(&str, &str)]) -> Result<Config> {
        let variable = |name: &str| {
            variables
                .iter()
                .find(|(n, _)| *n == name)
                .map(|(_, v)| OsString::from(v))
        };
        Config::of(text, Some(Path::new("/home/me/.config/skin/config.toml")), &variable)
    }

    #[test]
    fn variables_overrule_the_file_and_files_are_beside_it() {
        let plain = of(TEXT, &[]).unwrap();
        assert_eq!(plain.serial.as_deref(), Some("A7"));
        assert_eq!(
            plain.sheet.as_deref(),
            Some(Path::new("/home/me/.config/skin/square.toml"))
        );
        assert_eq!((plain.listen, plain.open), (Some(9000), Some(false)));
        let other = of(
            TEXT,
            &[
                ("SKIN_PORT", "/dev/ttyUSB3"),
                ("SKIN_SHEET", "here.toml"),
                ("SKIN_LISTEN", "0"),
            ],
        )
        .unwrap();
        assert_eq!((other.port.as_deref(), other.serial), (Some("/dev/ttyUSB3"), None));
        assert_eq!(
            (other.sheet.as_deref(), other.listen),
            (Some(Path::new("here.toml")), Some(0))
        );
        assert_eq!(of("", &[]).unwrap(), Config::default());
    }

    #[test]
    fn what_is_not_understood_is_said() {
        for (text, variables, part) in [
            ("prot = \"x\"", &[][..], "config.toml"),
            (
                "",
                &[("SKIN_LISTEN", "many")][..],
                "SKIN_LISTEN is \"many\"; give a port",
            ),
            ("", &[("SKIN_OPEN", "perhaps")][..], "true or false"),
            ("port = \"a\"\nserial = \"b\"", &[][..], "leave one of them out"),
        ] {
            let said = format!("{:#}", of(text, variables).unwrap_err());
            assert!(said.contains(part), "{said}");
        }
    }

    #[cfg(unix)]
    #[test]
    fn the_file_is_where_the_system_keeps_such_files() {
        let at = |variables: &[(&str, &str)]| {
            place(&|name: &str| {
                variables
                    .iter()
                    .find(|(n, _)| *n == name)
                    .map(|(_, v)| OsString::from(v))
            })
        };
        let path = |text: &str| Some(PathBuf::from(text));
        assert_eq!(at(&[("HOME", "/home/me")]), path("/home/me/.config/skin/config.toml"));
        assert_eq!(
            at(&[("HOME", "/home/me"), ("XDG_CONFIG_HOME", "/c")]),
            path("/c/skin/config.toml")
        );
        assert_eq!(at(&[("XDG_CONFIG_HOME", "relative")]), None);
    }
}
