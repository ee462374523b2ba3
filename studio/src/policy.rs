//! The Content-Security-Policy of the page: what it may connect to besides its own server.

use axum::http::Uri;
use std::fmt;
use std::str::FromStr;

/// Any port of this machine.
const LOOPBACK: &str = "http://127.0.0.1:* http://localhost:*";

/// The settings of the page, and what it may connect to.
#[derive(Debug, Clone)]
pub struct Settings {
    /// Where the page finds the planner.
    pub planner: PlannerAddress,
    /// Further origins that the page may call once its user agrees.
    pub connect: Vec<Origin>,
    /// Whether only this machine can open the page. It may then call any port of this machine.
    pub is_local: bool,
}

/// Where the page finds the planner.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum PlannerAddress {
    /// This port of the host that the page comes from.
    Port(u16),
    /// A URL, whatever host the page comes from.
    Url {
        /// The URL as it was given.
        text: String,
        /// Its origin.
        origin: Origin,
    },
}

impl FromStr for PlannerAddress {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if let Some(port) = text.strip_prefix(':') {
            let port = port.parse::<u16>().map_err(|_| "a port is a number up to 65535".to_owned())?;
            return Ok(Self::Port(port));
        }
        let origin = origin_of(&uri(text)?)?;
        Ok(Self::Url { text: text.to_owned(), origin })
    }
}

impl fmt::Display for PlannerAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Port(port) => write!(f, ":{port}"),
            Self::Url { text, .. } => f.write_str(text),
        }
    }
}

/// Scheme, host and port, such as `https://plans.example:7601`, kept as a source of a policy.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Origin(String);

impl FromStr for Origin {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let uri = uri(text)?;
        if !matches!(uri.path(), "" | "/") || uri.query().is_some() {
            return Err("an origin ends after its host and port".to_owned());
        }
        origin_of(&uri)
    }
}

fn uri(text: &str) -> Result<Uri, String> {
    text.parse::<Uri>().map_err(|error| format!("this is not a URL: {error}"))
}

fn origin_of(uri: &Uri) -> Result<Origin, String> {
    let (Some(scheme @ ("http" | "https")), Some(authority)) = (uri.scheme_str(), uri.authority()) else {
        return Err("a URL begins with http:// or https://".to_owned());
    };
    let host = authority.host();
    let port = authority.port_u16().map(|port| format!(":{port}")).unwrap_or_default();
    // They differ if there is a user name, or a port that is out of range.
    if authority.as_str() != format!("{host}{port}") {
        return Err("a URL holds a host, and a port up to 65535, and no user name".to_owned());
    }
    if host.starts_with('[') {
        // A policy cannot name IPv6 addresses: it names their port, of any host.
        return if port.is_empty() {
            Err("an IPv6 address needs a port".to_owned())
        } else {
            Ok(Origin(format!("{scheme}://*{port}")))
        };
    }
    if !can_be_named(host) {
        return Err(format!("`{host}` is not a host name of ASCII letters, digits, hyphens and dots"));
    }
    Ok(Origin(format!("{scheme}://{host}{port}")))
}

/// Whether a policy can name a host: letters, digits and hyphens, separated by dots.
fn can_be_named(host: &str) -> bool {
    let is_label =
        |label: &str| !label.is_empty() && label.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'-');
    host.split('.').all(is_label)
}

/// The policy of a page that comes from `host`. Other origins may only be called; nothing is loaded from them.
pub(crate) fn policy(settings: &Settings, host: Option<&str>) -> String {
    let planner = match &settings.planner {
        // A source without a scheme has the scheme of the page, even behind a proxy that adds TLS.
        PlannerAddress::Port(port) => format!("{}:{port}", host.filter(|host| can_be_named(host)).unwrap_or("*")),
        PlannerAddress::Url { origin, .. } => origin.0.clone(),
    };
    let mut sources = vec!["'self'", planner.as_str()];
    sources.extend(settings.connect.iter().map(|origin| origin.0.as_str()));
    sources.extend(settings.is_local.then_some(LOOPBACK));
    format!(
        "default-src 'self'; connect-src {}; img-src 'self' data: blob:; style-src 'self' 'unsafe-inline'; \
         worker-src 'self' blob:; frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
        sources.join(" ")
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sources(planner: &str, connect: &[&str], is_local: bool, host: Option<&str>) -> String {
        let connect = connect.iter().map(|origin| origin.parse::<Origin>().expect("an origin")).collect();
        let planner = planner.parse::<PlannerAddress>().expect("an address");
        let settings = Settings { planner, connect, is_local };
        let policy = policy(&settings, host);
        let (_, rest) = policy.split_once("; connect-src ").expect("the policy names what may be called");
        rest.split_once(';').expect("more follows").0.to_owned()
    }

    #[test]
    fn the_policy_names_what_may_be_called() {
        /// Planner, further origins, whether the server is local, the page's host, and what the policy names.
        type Case<'a> = (&'a str, &'a [&'a str], bool, Option<&'a str>, &'a str);
        let cases: [Case<'_>; 7] = [
            (":7601", &[], false, Some("worlds.example"), "'self' worlds.example:7601"),
            (":7601", &[], false, Some("192.168.1.7"), "'self' 192.168.1.7:7601"),
            (":7601", &[], false, Some("[::1]"), "'self' *:7601"),
            (":7601", &[], false, Some("a;script-src"), "'self' *:7601"),
            (":7601", &[], false, None, "'self' *:7601"),
            ("https://plans.example/planner/", &[], false, Some("worlds.example"), "'self' https://plans.example"),
            (
                "http://[fd00::1]:9000",
                &["https://a.example:444", "http://b.example/"],
                true,
                Some("localhost"),
                "'self' http://*:9000 https://a.example:444 http://b.example http://127.0.0.1:* http://localhost:*",
            ),
        ];
        for (planner, connect, is_local, host, expected) in cases {
            assert_eq!(sources(planner, connect, is_local, host), expected, "{planner} at {host:?}");
        }
    }

    #[test]
    fn what_a_policy_cannot_name_is_refused() {
        for text in [
            "",
            "*",
            "plans.example:7601",
            "ftp://plans.example",
            "https://*",
            "https://*:7601",
            "https://*.example",
            "https://plans.example; script-src *",
            "https://plans.example;script-src",
            "https://user@plans.example",
            "https://user:secret@plans.example",
            "https://plans.example:99999",
            "https://plans_here.example",
            "https://plans..example",
            "https://[::1]",
        ] {
            assert!(text.parse::<Origin>().is_err(), "{text} is taken for an origin");
            assert!(text.parse::<PlannerAddress>().is_err(), "{text} is taken for the planner's address");
        }
        assert!("https://plans.example/path".parse::<Origin>().is_err());
        assert!(":99999".parse::<PlannerAddress>().is_err());
        assert!(":7601".parse::<Origin>().is_err());
    }

    #[test]
    fn the_page_is_told_the_address_as_it_was_given() {
        for text in [":7601", "https://plans.example/planner/"] {
            assert_eq!(text.parse::<PlannerAddress>().expect("an address").to_string(), text);
        }
    }
}
