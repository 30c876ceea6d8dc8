from unitree_sdk2py.idl.unitree_hg.msg.dds_ import LowCmd_


def unitree_hg_msg_dds__LowCmd_():
    return LowCmd_()
