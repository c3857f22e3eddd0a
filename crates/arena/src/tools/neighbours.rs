//! Whether somebody speaks on a domain's bus already.

use std::time::Duration;

use service_shell::{BusReceiver, Listen, ShellError};
use settings::Network;
use wire::Domain;

/// Every node announces itself each second.
const LISTENING: Duration = Duration::from_millis(1_200);

/// Listens to a domain's group for a moment: the topic of the first datagram of our format there. Keys do not matter:
/// whoever speaks there may have vehicles in the air. To be called within a tokio runtime.
///
/// # Errors
/// What the system says.
pub async fn heard(network: &Network, domain: Domain) -> Result<Option<String>, ShellError> {
    let mut bus = BusReceiver::join(network, domain, Listen::Everything)?;
    let listening = async {
        loop {
            let count = bus.next_batch().await?;
            for index in 0..count {
                if let Ok(opened) = wire::open(bus.datagram(index).bytes)
                    && opened.claimed().domain == domain
                {
                    return Ok(Some(opened.topic().name().escape_default().to_string()));
                }
            }
        }
    };
    // Nothing heard in that time is silence.
    tokio::time::timeout(LISTENING, listening).await.unwrap_or(Ok(None))
}
