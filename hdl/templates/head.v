{% if licence %}
// SPDX-License-Identifier: {{ licence }}
{% endif %}
// Made by skymosaic {{ version }}: {{ command }}
// Digest of the configuration: {{ digest }}
`timescale 1ns / 1ps
