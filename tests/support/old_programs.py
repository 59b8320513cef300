"""Programs as workshops have them. The documents show them, and tests translate them."""

#: Three beads of glue in RAPID, 60 mm long and 30 mm apart, with an arc at the end.
RAPID = """\
MODULE Gluing
  PERS tooldata tGun:=[TRUE,[[0,0,100],[1,0,0,0]],[2,[0,0,80],[1,0,0,0],0,0,0]];
  PERS wobjdata wTable:=[FALSE,TRUE,"",[[320,-40,150],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];
  CONST jointtarget jHome:=[[0,0,0,0,60,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  CONST robtarget pFirst:=[[0,0,0],[0,1,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];

  PROC main()
    MoveAbsJ jHome,v500,fine,tGun\\WObj:=wTable;
    FOR i FROM 0 TO 2 DO
      bead 30*i;
    ENDFOR
    MoveAbsJ jHome,v500,fine,tGun\\WObj:=wTable;
  ENDPROC

  PROC bead(num y)
    MoveJ Offs(pFirst,0,y,50),v300,z10,tGun\\WObj:=wTable;
    MoveL Offs(pFirst,0,y,0),v100,fine,tGun\\WObj:=wTable;
    Set doGun;
    MoveL Offs(pFirst,50,y,0),v40,fine,tGun\\WObj:=wTable;
    MoveC Offs(pFirst,57.071,y+2.929,0),Offs(pFirst,60,y+10,0),v40,fine,tGun\\WObj:=wTable;
    Reset doGun;
    WaitTime 0.2;
    MoveL Offs(pFirst,60,y+10,50),v100,z10,tGun\\WObj:=wTable;
  ENDPROC
ENDMODULE
"""
#: A square in V+ that is run twice.
VPLUS = """\
.PROGRAM square()
    AUTO i, corner, high
    SET corner = TRANS(250, -40, 150, 0, 180, 180)
    SET high = corner:TRANS(0, 0, -30, 0, 0, 0)
    TOOL TRANS(0, 0, 80, 0, 0, 0)
    SPEED 50 ALWAYS
    MOVE high
    BREAK
    FOR i = 1 TO 2
        SPEED 40 MMPS ALWAYS
        MOVES corner
        BREAK
        SIGNAL 5
        MOVES SHIFT(corner BY 60, 0, 0)
        MOVES SHIFT(corner BY 60, 80, 0)
        MOVES SHIFT(corner BY 0, 80, 0)
        MOVES corner
        BREAK
        SIGNAL -5
        DEPARTS 30
        BREAK
    END
.END
"""
#: PacScript that turns a nut above two holes.
PACSCRIPT = """\
Sub Main
    Dim i As Integer
    TakeArm Keep = 0
    Speed 50
    For i = 0 To 1
        Move P, @E P(300 + 40 * i, 0, 250, 180, 0, 180, -1)
        Move L, @0 P(300 + 40 * i, 0, 200, 180, 0, 180, -1)
        Set IO[24]
        Delay 200
        Reset IO[24]
        Move L, @E P(300 + 40 * i, 0, 250, 180, 0, 180, -1)
    Next i
    GiveArm
End Sub
"""
