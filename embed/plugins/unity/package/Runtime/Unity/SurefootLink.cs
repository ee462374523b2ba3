using System;
using UnityEngine;

namespace Surefoot.Unity
{
    /// <summary>Data of an imported NavMeshLink: the move of a character on it, for animation.</summary>
    public sealed class SurefootLink : MonoBehaviour
    {
        [Tooltip("The most demanding ability, such as jump")] public string ability = "";
        [Tooltip("Estimated chance that an NPC with the policy gets through, 0 to 1")] public float chance = 1;
        [Tooltip("Duration, s")] public float seconds;
        public Leap[] leaps = new Leap[0];

        /// <summary>One move off the ground; places are relative to the link's parent, m.</summary>
        [Serializable]
        public struct Leap
        {
            public string ability;
            public Vector3 takeOff;
            public Vector3 apex;
            public Vector3 landing;
            public float seconds;
        }
    }
}
