//! No playback beside vehicles that fly.

use std::time::Duration;

use service_shell::{BusReceiver, Listen};
use settings::Network;
use wire::Domain;

use crate::PlayError;

/// Every node announces itself each second.
const LISTENING: Duration = Duration::from_millis(1_200);

/// Listens to the live group for a moment and refuses if anything of a live arena is heard. Keys do not matter: whoever
/// speaks our format there may have vehicles in the air. To be called within a tokio runtime.
///
/// # Errors
/// [`PlayError::Live`], or what the system says.
pub async fn refuse_beside_live(network: &Network) -> Result<(), PlayError> {
    let mut bus = BusReceiver::join(network, Domain::Live, Listen::Everything)?;
    let listening = async {
        loop {
            let count = bus.next_batch().await?;
            for index in 0..count {
                let opened = wire::open(bus.datagram(index).bytes);
                if let Ok(opened) = opened
                    && opened.claimed().domain == Domain::Live
                {
                    let (group, port) = (network.live.group, network.live.port);
                    let topic = opened.topic().name().escape_default().to_string();
                    return Err(PlayError::Live { topic, group, port });
                }
            }
        }
    };
    // Nothing heard in that time is what is hoped for.
    tokio::time::timeout(LISTENING, listening).await.unwrap_or(Ok(()))
}
