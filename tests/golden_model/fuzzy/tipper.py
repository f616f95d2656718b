"""A small system as MATLAB's Fuzzy Logic Toolbox writes it."""

TIPPER = """\
[System]
Name='tipper'
Type='sugeno'
Version=2.0
NumInputs=2
NumOutputs=1
NumRules=3
AndMethod='min'
OrMethod='max'
ImpMethod='prod'
AggMethod='sum'
DefuzzMethod='wtaver'

[Input1]
Name='service'
Range=[0 10]
NumMFs=2
MF1='poor':'trimf',[-10 0 10]
MF2='very good':'gaussmf',[1.5 10]

[Input2]
Name='food'
Range=[0 10]
NumMFs=2
MF1='bad':'trapmf',[0 0 2 8]
MF2='nice':'trapmf',[2 8 10 10]

[Output1]
Name='tip'
Range=[0 30]
NumMFs=3
MF1='low':'constant',[5]
MF2='mid':'linear',[0 0 15]
MF3='high':'constant',[25]

[Rules]
1 1, 1 (1) : 2
2 0, 2 (1) : 1
2 2, 3 (1) : 1
"""
