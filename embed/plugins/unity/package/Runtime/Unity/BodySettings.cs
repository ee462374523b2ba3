using System;
using UnityEngine;

namespace Surefoot.Unity
{
    /// <summary>A <see cref="Body"/> for the inspector. The values at first are those that policies were trained with.</summary>
    [Serializable]
    public sealed class BodySettings
    {
        [Range(0.3f, 4)] public float height = 1.8f;
        [Range(0.15f, 1)] public float radius = 0.3f;
        [Tooltip("Top speed forward, m/s"), Range(0.1f, 20)] public float forwardSpeed = 11;
        [Tooltip("Top speed backwards and sideways as a share of that"), Range(0, 1)] public float sideSpeedShare = 0.6f;
        [Tooltip("Degrees per second"), Range(6, 1145)] public float turnSpeed = 180;
        [Tooltip("Upward speed of a jump, m/s"), Range(0, 30)] public float jumpSpeed = 10;
        [Tooltip("m/s2"), Range(1, 100)] public float gravity = 20;
        [Tooltip("Steepest walkable slope, degrees"), Range(0, 80)] public float maxSlope = 35;
        [Tooltip("Highest step that is climbed without a jump, m; at most half of the height"), Range(0, 2)] public float stepHeight = 0.35f;
        [Tooltip("m/s2"), Range(1, 1000)] public float groundAcceleration = 60;
        [Tooltip("m/s2"), Range(0, 1000)] public float airAcceleration = 25;
        [Tooltip("Jumps in the air before the character must land"), Range(0, 255)] public int extraJumps = 1;

        public Body ToBody()
        {
            Body body = Body.Default;
            body.Height = height;
            body.Radius = radius;
            body.ForwardSpeed = forwardSpeed;
            body.SideSpeedShare = sideSpeedShare;
            body.TurnSpeed = turnSpeed * Mathf.Deg2Rad;
            body.JumpSpeed = jumpSpeed;
            body.Gravity = gravity;
            body.MaxSlope = maxSlope * Mathf.Deg2Rad;
            body.StepHeight = stepHeight;
            body.GroundAcceleration = groundAcceleration;
            body.AirAcceleration = airAcceleration;
            body.ExtraJumps = (uint)extraJumps;
            return body;
        }

        /// <summary>Gives a controller the same size, without moving its feet.</summary>
        internal void Shape(CharacterController controller)
        {
            float feet = controller.center.y - controller.height / 2;
            controller.radius = radius;
            controller.height = height;
            controller.center = new Vector3(0, feet + height / 2, 0);
            controller.slopeLimit = maxSlope;
            controller.stepOffset = stepHeight;
        }
    }
}
