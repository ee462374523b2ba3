using System.Collections.Generic;
using UnityEngine;

namespace Surefoot.Unity
{
    /// <summary>
    /// A jump pad, zip line, teleporter or jetpack of the level, on the ground, that agents sense. What it does to characters is up to the
    /// game: see <see cref="SurefootAgent.Velocity"/>.
    /// </summary>
    [AddComponentMenu("Surefoot/Surefoot Device")]
    public sealed class SurefootDevice : MonoBehaviour
    {
        private static readonly List<SurefootDevice> Enabled = new List<SurefootDevice>();

        [SerializeField, Tooltip("Pad, ZipLine, Teleporter or Jetpack")] private Surface kind = Surface.Pad;
        [SerializeField, Tooltip("Where a zip line or teleporter leads, on the ground")] private Transform target;
        [SerializeField, Tooltip("Whether a teleporter leads back as well")] private bool twoWay;

        /// <summary>Grows whenever a device appears or disappears.</summary>
        internal static int Changes { get; private set; }

        internal static Device[] All(UnityFrame frame)
        {
            Device[] devices = new Device[Enabled.Count];
            for (int idx = 0; idx < devices.Length; idx++)
            {
                SurefootDevice device = Enabled[idx];
                Vector3 from = device.transform.position;
                devices[idx].Kind = device.kind;
                devices[idx].TwoWay = device.twoWay ? 1 : 0;
                devices[idx].From = frame.ToMap(from.ToVec3());
                devices[idx].To = frame.ToMap((device.target == null ? from : device.target.position).ToVec3());
            }
            return devices;
        }

        private void OnEnable()
        {
            Enabled.Add(this);
            Changes++;
        }

        private void OnDisable()
        {
            Enabled.Remove(this);
            Changes++;
        }
    }
}
